"""Puts this folder's helpers on the path: test modules are imported by file."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
