"""rerun's viewer for a running session: `python -m humanoid_sim.rerun`."""

import sys

from humanoid_sim.cli import run_program
from humanoid_sim.frontends.rerun import main

__all__ = ["main"]

if __name__ == "__main__":
    sys.exit(run_program(main))
