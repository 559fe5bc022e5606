"""Lets the tests of this folder import their shared helpers."""

import sys
from pathlib import Path

# importlib mode leaves sys.path alone.
sys.path.append(str(Path(__file__).parent))
