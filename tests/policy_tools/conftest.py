"""The fixtures of `tests/policy`: importlib mode leaves sys.path alone."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "policy"))

from policy_fixtures import *  # noqa: F403
