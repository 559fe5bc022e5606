import sys
from pathlib import Path

# importlib mode leaves sys.path alone.
sys.path += [str(Path(__file__).parent), str(Path(__file__).parents[1] / "policy")]

from play_fixtures import folder, make_robot, quick, run

__all__ = ["folder", "make_robot", "quick", "run"]
