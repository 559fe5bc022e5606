"""Puts this folder's helpers, and `published`, on the path: test modules are imported by file."""

import os
import sys
from pathlib import Path

sys.path += [str(Path(__file__).parent), str(Path(__file__).parents[1] / "policy")]
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # as the package does before it imports ONNX Runtime
