"""Lets the tests of this folder import the samples of recordings: importlib mode leaves sys.path alone."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "recording"))
