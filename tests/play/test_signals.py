"""Signals to a real process in mid-motion."""

import subprocess
import sys

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.play.console import PlayConsole
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.play.run import bring_up

PLACEHOLDER = ("--policy", "placeholder")  # which loads no network
OPTIONS = (*PLACEHOLDER, "--pace", "realtime")


PLAY = (sys.executable, "-m", "humanoid_sim.play", "--viewer", "none", "--record", "r.mcap")


def test_a_question_that_nobody_reads_enables_nothing(monkeypatch):
    class Asking:
        question = "Enable?"

        def prepare(self): ...

        def checks(self):
            return [("ok", "can0", "all there")]

    console = PlayConsole()
    console.is_unread = True
    monkeypatch.setattr("sys.stdin", type("Terminal", (), {"isatty": lambda _: True})())
    with pytest.raises(InputError, match="--yes: is needed where the question cannot be read"):
        bring_up(Asking(), PlayConfig(hardware="can0"), console)


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
