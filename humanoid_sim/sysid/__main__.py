"""`python -m humanoid_sim.sysid`."""

import sys

from humanoid_sim.cli import run_program
from humanoid_sim.sysid import main

sys.exit(run_program(main))
