"""`python -m humanoid_sim.hardware.guardian`: started by whoever drives motors that need one, never by hand."""

import sys

from humanoid_sim.hardware.guardian.process import main

sys.exit(main(sys.argv[1:]))
