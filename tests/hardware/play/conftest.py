"""`play` on emulated motors; the quick robot and the way to run are those of the tests of `play`."""

from __future__ import annotations

import sys
from pathlib import Path

# importlib mode leaves sys.path alone.
sys.path += [
    str(Path(__file__).parents[2] / name)
    for name in ("play", "policy", "hardware/imu", "hardware/play", "frontends/dds")
]

from play_fixtures import folder, make_robot, quick, run

__all__ = ["folder", "make_robot", "quick", "run"]
