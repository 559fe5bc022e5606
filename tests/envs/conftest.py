"""Helpers of other folders that these tests use."""

from __future__ import annotations

import sys
from pathlib import Path

# importlib mode leaves sys.path alone.
sys.path.append(str(Path(__file__).parents[1] / "policy"))
