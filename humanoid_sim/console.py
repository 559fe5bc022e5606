"""A page for the operator of a running session: `python -m humanoid_sim.console`."""

import sys

from humanoid_sim.cli import run_program
from humanoid_sim.frontends.console import main

__all__ = ["main"]

if __name__ == "__main__":
    sys.exit(run_program(main))
