"""`python -m humanoid_sim.testing`: there is no such program."""

import sys

print(
    "error: humanoid_sim.testing: is not a program, import it in tests of your own; see docs/testing.md",
    file=sys.stderr,
)
sys.exit(2)
