"""Helpers of this folder and others that these tests use."""

import sys
from pathlib import Path

# importlib mode leaves sys.path alone.
sys.path += [str(Path(__file__).parent), str(Path(__file__).parents[1] / "policy")]
