"""What the loop needs is loaded before it begins: an import in a tick takes as long as several ticks."""

import subprocess
import sys

PROGRAM = """
import sys
from humanoid_sim.play import main
from humanoid_sim.session.session import Session

tick, known = Session.tick, set()

def watched(self, *intents):
    before = set(known)
    tick(self, *intents)
    known.update(sys.modules)
    if before and known - before:
        print("loaded in a tick:", *sorted(known - before))

Session.tick = watched
sys.exit(main(sys.argv[1:]))
"""
MODES = "hold 0.1; damp; hold 0.1; load_a; wait; start_locomotion; hold 0.3; damp; hold 0.1; load_b; wait; start_remote"


def test_no_tick_of_any_mode_loads_a_module(folder, quick):
    script = ("--script", f"{MODES}; hold 0.1; damp; hold 0.1", "--viewer", "none", "--record", "r.mcap")
    command = [sys.executable, "-c", PROGRAM, "--robot", quick, "--pace", "fast", *script]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert "LOCOMOTION → DAMPING" in run.stdout, run.stderr
    assert "→ REMOTE" in run.stdout
    assert "loaded in a tick" not in run.stdout
