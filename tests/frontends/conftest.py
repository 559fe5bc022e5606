"""Lets the modules here import `virtual_pads`: importlib mode leaves sys.path alone."""

import os
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
