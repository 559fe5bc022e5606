"""`python -m humanoid_sim.regress`."""

import sys

from humanoid_sim.cli import run_program
from humanoid_sim.regress import main

sys.exit(run_program(main))
