"""MuJoCo's window for a running session, or for a robot: `python -m humanoid_sim.viewer`."""

import sys

from humanoid_sim.cli import run_program
from humanoid_sim.frontends.viewer import main

__all__ = ["main"]

if __name__ == "__main__":
    sys.exit(run_program(main))
