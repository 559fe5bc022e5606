"""`python -m humanoid_sim.training`."""

import sys

from humanoid_sim.cli import run_program
from humanoid_sim.training import main

sys.exit(run_program(main))
