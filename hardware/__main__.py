"""`python -m humanoid_sim.hardware`."""

import sys

from humanoid_sim.cli import run_program
from humanoid_sim.hardware.tools import main

sys.exit(run_program(main))
