"""`python -m tools.bench`."""

import sys

from humanoid_sim.cli import run_program
from tools.bench import main

sys.exit(run_program(main))
