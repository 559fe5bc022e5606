"""The keys of a MIDI keyboard for a running session: `python -m humanoid_sim.midi`."""

import sys

from humanoid_sim.cli import run_program
from humanoid_sim.frontends.midi import main

__all__ = ["main"]

if __name__ == "__main__":
    sys.exit(run_program(main))
