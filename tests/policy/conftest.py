"""Lets the modules here, and those of `play`, import `models`: importlib mode leaves sys.path alone."""

import os
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # as the package does before it imports ONNX Runtime

from policy_fixtures import *  # noqa: F403
