"""Signals to a real process in mid-motion."""

import signal
import subprocess
import sys
from contextlib import contextmanager

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.messages import TickRecord
from humanoid_sim.play.console import PlayConsole
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.play.run import bring_up
from humanoid_sim.recording.reader import open_recording

PLACEHOLDER = ("--policy", "placeholder")  # which loads no network
OPTIONS = (*PLACEHOLDER, "--pace", "realtime")


def usual_signals():
    """Undo what the test runner may have inherited: a job in the background ignores SIGINT, one under nohup SIGHUP."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


PLAY = (sys.executable, "-m", "humanoid_sim.play", "--viewer", "none", "--record", "r.mcap")


@contextmanager
def playing(folder, *options, stdin=None, stdout=subprocess.PIPE, stderr=subprocess.STDOUT):
    """A process that plays and records into `r.mcap`; killed at the end if it still runs."""
    with subprocess.Popen(
        [*PLAY, *options],
        cwd=folder,
        stdin=stdin,
        stdout=stdout,
        stderr=stderr,
        text=True,
        preexec_fn=usual_signals,  # noqa: PLW1509 - no thread of the tests runs here
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def wait_for(process, text):
    """The output up to a line that holds `text`."""
    seen = ""
    for line in process.stdout:
        seen += line
        if text in line:
            return seen
    raise AssertionError(f"{text!r} never came:\n{seen}")


def finished(process):
    out, _ = process.communicate(timeout=120.0)
    return out


def recorded(folder):
    recording = open_recording(folder / "r.mcap")
    entries = list(recording.entries())
    assert recording.is_complete
    ticks = [entry for entry in entries if isinstance(entry, TickRecord)]
    assert [tick.index for tick in ticks] == list(range(len(ticks)))
    return ticks, [entry.text for entry in entries if not isinstance(entry, TickRecord)]


@pytest.mark.soak
def test_a_reader_that_leaves_does_not_stop_the_run(folder, quick):
    with playing(folder, "--robot", quick, "--script", "damp; hold 0.5", "--summary", "s.json", *OPTIONS) as process:
        wait_for(process, "DAMPING")
        process.stdout.close()
        process.wait(timeout=30.0)
    assert process.returncode == 0
    ticks, events = recorded(folder)
    assert events == ["ending: script finished"]
    assert ticks[-1].output.quit
    assert (folder / "s.json").is_file()


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
