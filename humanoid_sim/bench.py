"""`python -m humanoid_sim.bench`, which measured this machine: where that is now."""

import sys

if __name__ == "__main__":
    print("error: bench is not part of the package any more; in a checkout: make bench", file=sys.stderr)
    sys.exit(2)
