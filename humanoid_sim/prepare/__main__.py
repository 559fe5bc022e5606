"""`python -m humanoid_sim.prepare`."""

import sys

from humanoid_sim.cli import run_program
from humanoid_sim.prepare import main

sys.exit(run_program(main))
