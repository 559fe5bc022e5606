"""Lets the modules here import each other, and `published` of the tests of policies: importlib mode leaves that out."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parent.parent / "policy"))
