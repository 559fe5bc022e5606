"""`python -m humanoid_sim <verb>`: the same as the console script `humanoid-sim`."""

import sys

from humanoid_sim.cli import main

sys.exit(main())
