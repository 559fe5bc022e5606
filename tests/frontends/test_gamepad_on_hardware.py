"""A gamepad on emulated motors: `play` and the gamepad's program in processes of their own, lost in every way."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

pytest.importorskip("pygame", reason="pygame-ce is not installed (extra 'gamepad')")

from humanoid_sim.client import Feed, find_session
from humanoid_sim.recording.reader import open_recording

pytestmark = pytest.mark.slow

HERE = Path(__file__).parent


@contextmanager
def program(*words: str, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    environment = {**os.environ, "PYTHONPATH": f"{os.environ.get('PYTHONPATH', '')}:{HERE}"}
    with subprocess.Popen(
        [sys.executable, *words], cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, env=environment
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def until(condition: Callable[[], object], seconds: float = 30.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.002)


def unplug(pad: subprocess.Popen[bytes]) -> None:
    assert pad.stdin is not None
    pad.stdin.write(b"unplug\n")
    pad.stdin.flush()


LOSSES: dict[str, Callable[[subprocess.Popen[bytes]], None]] = {
    "unplugged": unplug,
    "killed": lambda pad: pad.send_signal(signal.SIGKILL),
    "stopped": lambda pad: pad.send_signal(signal.SIGSTOP),
}


@pytest.mark.parametrize("loss", LOSSES)
def test_the_loss_of_the_gamepad_damps_in_locomotion(
    loss: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    options = ("--hardware", f"virtual:pad-{loss}", "--gamepad", "--yes", "--record", "r.mcap", "--viewer", "none")
    with program("-m", "humanoid_sim.play", *options, folder=tmp_path) as play:

        def session() -> object:
            try:
                return find_session(play.pid)
            except Exception:
                return None

        until(session)
        with (
            Feed(find_session(play.pid)) as feed,
            program(str(HERE / "pad_program.py"), "--session", str(play.pid), folder=tmp_path) as pad,
        ):

            def mode() -> str:
                sample = feed.latest()
                return "" if sample is None else str(feed.decode(sample)["mode"])

            def press(*buttons: str) -> None:
                assert pad.stdin is not None
                for verb in ("press", "release"):
                    pad.stdin.write(f"{verb} {' '.join(buttons)}\n".encode())
                    pad.stdin.flush()
                    time.sleep(0.1)

            until(feed.latest)
            damping = None
            for buttons in (("X",), ("L1", "A")):
                before = mode()
                until(lambda buttons=buttons, before=before: (press(*buttons), mode() != before)[1])
                damping = damping or mode()
            standby = mode()
            until(lambda: (press("R1", "A"), mode() not in (standby, damping))[1])
            locomotion = mode()
            time.sleep(0.5)
            assert mode() == locomotion
            begun = time.monotonic()
            LOSSES[loss](pad)
            until(lambda: mode() == damping, 1.0)
            took = time.monotonic() - begun
            print(f"\n{loss}: DAMPING after {1e3 * took:.0f} ms")
            assert took < (0.1 if loss == "unplugged" else 0.25) + 0.1  # the slack is for this test's own look
            time.sleep(0.2)
            play.send_signal(signal.SIGINT)
            play.wait(20.0)
            pad.send_signal(signal.SIGCONT)
    recording = open_recording(tmp_path / "r.mcap")
    modes = [tick.output.control_mode.mode.name for tick in recording.ticks()]
    assert modes.index("LOCOMOTION") > 0
    assert modes[-1] in {"DAMPING", "ZERO_TORQUE"}
