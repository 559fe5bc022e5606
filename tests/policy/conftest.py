"""Lets the modules here, and those of `play`, import `models`: importlib mode leaves sys.path alone."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
