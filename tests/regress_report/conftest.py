"""Lets the tests of this folder import `invented`."""

import sys
from pathlib import Path

# importlib mode leaves sys.path alone.
sys.path.append(str(Path(__file__).parent))
