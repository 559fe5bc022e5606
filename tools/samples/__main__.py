"""`python -m tools.samples`."""

import sys

from humanoid_sim.cli import run_program
from tools.samples import main

sys.exit(run_program(main))
