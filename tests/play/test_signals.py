"""Signals to a real process in mid-motion."""

import subprocess
import sys

import pytest


@pytest.mark.soak
def test_an_output_that_fails_in_mid_run_does_not_stop_it(folder, quick):
    """`ulimit -f` lets files grow to 1 KiB only; a recording would not fit either."""
    options = f"--viewer none --record none --robot {quick} --script 'damp; hold 0.5; load_a; hold 0.2' --pace fast"
    line = f"trap '' XFSZ; ulimit -f 1; exec {sys.executable} -B -m humanoid_sim.play {options} --summary s.json >> out"
    (folder / "out").write_text(" " * 900, encoding="utf-8")
    run = subprocess.run(["bash", "-c", line], cwd=folder, stderr=subprocess.PIPE, text=True, check=False)
    assert "Traceback" not in run.stderr
    assert run.returncode == 1
    assert "File too large" in run.stderr
