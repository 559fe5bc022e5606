"""Whatever becomes of those who watch, the robot's log is the one of a run that nobody watched."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from humanoid_sim import replay
from humanoid_sim.cli import run_program
from humanoid_sim.client import Feed, find_session
from humanoid_sim.messages import Event, Mode
from humanoid_sim.recording.reader import open_recording

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("Xvfb") is None, reason="Xvfb is not installed (xvfb)"),
    pytest.mark.skipif(find_spec("foxglove") is None, reason="foxglove-sdk is not installed (foxglove)"),
]

SCRIPT = "hold 5; damp; hold 1; load_b; wait; hold 0.5; start_locomotion; hold 1; damp; hold 1"
OPTIONS = ("--policy", "placeholder", "--script", SCRIPT, "--record", "r.mcap", "--overwrite")


@contextmanager
def display() -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """An X server, and the name of its display."""
    reading, writing = os.pipe()
    command = ["Xvfb", "-displayfd", str(writing), "-screen", "0", "800x600x24", "-nolisten", "tcp"]
    with subprocess.Popen(command, pass_fds=[writing], stderr=subprocess.DEVNULL) as server:
        os.close(writing)
        try:
            with open(reading, encoding="ascii") as stream:
                yield server, f":{stream.readline().strip()}"
        finally:
            server.kill()


def log(path: Path) -> list[tuple[object, ...]]:
    """Every tick's mode, pose and command, bit for bit."""
    recording = open_recording(path)
    ticks = []
    for tick in recording.ticks():
        command, qpos = tick.output.command, tick.qpos
        fields = (command.position, command.velocity, command.effort, command.stiffness, command.damping, qpos)
        ticks.append((tick.output.control_mode.mode, *(np.asarray(field).tobytes() for field in fields)))
    assert recording.is_complete
    return ticks


@pytest.fixture(scope="module")
def unwatched(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[object, ...]]:
    folder = tmp_path_factory.mktemp("unwatched")
    command = [sys.executable, "-m", "humanoid_sim.play", *OPTIONS, "--viewer", "none", "--pace", "fast"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return log(folder / "r.mcap")


@pytest.mark.parametrize("fate", ["stopped", "killed", "display lost"])
def test_viewers_leave_the_control_log_as_it_is(
    fate: str, unwatched: list[tuple[object, ...]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    with display() as (server, name):
        monkeypatch.setenv("DISPLAY", name)
        command = [sys.executable, "-m", "humanoid_sim.play", *OPTIONS, "--viewer", "native", "--foxglove"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as play:
            try:
                said = _until_they_are_there(play)
                with Feed(find_session(play.pid)) as feed:
                    _until_mode(feed, Mode.STANDBY)
                    children = feed.status()["front_ends"]
                    blow = signal.SIGSTOP if fate == "stopped" else signal.SIGKILL
                    os.kill(children["foxglove"], blow)
                    _until_mode(feed, Mode.LOCOMOTION)
                    if fate == "display lost":
                        server.kill()
                    else:
                        os.kill(children["viewer"], blow)
                said += play.communicate(timeout=60.0)[0]
            finally:
                play.kill()
    assert play.returncode == 0, said
    if fate != "stopped":
        assert ends(tmp_path / "r.mcap") == {"foxglove": "-9", "viewer": "1" if fate == "display lost" else "-9"}
    watched = log(tmp_path / "r.mcap")
    assert len(watched) == len(unwatched)
    assert watched == unwatched
    assert run_program(replay.main, ["r.mcap"]) == 0


def ends(path: Path) -> dict[str, str]:
    """Names of front ends that ended during the run, and their exit status."""
    texts = [entry.text.split() for entry in open_recording(path).entries() if isinstance(entry, Event)]
    return {words[2]: words[-1] for words in texts if words[:2] == ["front", "end"] and words[3] == "ended"}


def _until_they_are_there(play: subprocess.Popen[str]) -> str:
    assert play.stdout is not None
    said = ""
    while not ("window of session" in said and "open a connection to" in said):
        line = play.stdout.readline()
        assert line, said
        said += line
    return said


def _until_mode(feed: Feed, mode: Mode) -> None:
    number = 0
    while True:
        sample = feed.wait(number, 20.0)
        assert sample is not None
        number = sample.number
        if feed.decode(sample)["mode"] >= int(mode):
            return
