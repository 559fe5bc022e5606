"""Lets the modules here import their helpers: importlib mode leaves sys.path alone."""

import os
import sys
from pathlib import Path

sys.path += [str(Path(__file__).parents[1] / name) for name in ("frontends", "frontends/dds", "play", "policy")]

from fates import folder, rows

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

__all__ = ["folder", "rows"]
