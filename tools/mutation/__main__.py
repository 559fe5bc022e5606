"""`python -m tools.mutation`."""

import sys

from humanoid_sim.cli import run_program
from tools.mutation import main

sys.exit(run_program(main))
