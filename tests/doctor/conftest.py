"""Lets the modules here import `mistakes`, and `published` of the policies: importlib mode leaves sys.path alone."""

import sys
from pathlib import Path

_HERE = Path(__file__).parent
sys.path += [str(_HERE), str(_HERE.parent / "policy")]
