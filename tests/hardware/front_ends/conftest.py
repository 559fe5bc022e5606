"""Lets the modules here import the helpers of front ends' tests: importlib mode leaves sys.path alone."""

import sys
from pathlib import Path

sys.path += [
    str(Path(__file__).parents[2] / name)
    for name in ("frontends", "frontends/dds", "play", "policy", "hardware/front_ends")
]

from fates import folder, rows

__all__ = ["folder", "rows"]
