"""`python -m humanoid_sim.bench`."""

import sys

from humanoid_sim.bench import main
from humanoid_sim.cli import run_program

sys.exit(run_program(main))
