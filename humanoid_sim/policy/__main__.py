"""`python -m humanoid_sim.policy`."""

import sys

from humanoid_sim.cli import run_program
from humanoid_sim.policy_tools import main

sys.exit(run_program(main))
