"""`python -m humanoid_sim.play`."""

import sys

from humanoid_sim.cli import run_program
from humanoid_sim.play import main

sys.exit(run_program(main))
