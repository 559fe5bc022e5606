"""A session that begins without a policy, from outside: `play` in a process of its own, its feed and its intake."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from humanoid_sim import replay
from humanoid_sim.cli import run_program
from humanoid_sim.client import Feed, Intake, find_session, running_sessions
from humanoid_sim.messages import Event, Mode, TickRecord
from humanoid_sim.recording.reader import open_recording

__all__ = ["LONG", "Session", "playing", "quit_and_replay"]

LONG = 120.0
"""s for anything that only has to happen."""


@dataclass
class Session:
    """`play` in a process of its own."""

    process: subprocess.Popen[bytes]
    feed: Feed
    intake: Intake
    folder: Path

    def until(self, condition: Callable[[], object]) -> None:
        deadline = time.monotonic() + LONG
        while not condition():
            assert self.process.poll() is None, (self.folder / "out.txt").read_text(encoding="utf-8")
            assert time.monotonic() < deadline, "it never came"
            time.sleep(0.005)

    def tick(self) -> dict[str, object]:
        sample = self.feed.latest()
        return {} if sample is None else self.feed.decode(sample)

    def stand(self) -> None:
        """To the end of STANDBY."""
        assert self.intake.ask("damp", LONG).granted
        assert self.intake.ask("load_a", LONG).granted
        self.until(lambda: any(state["is_finished"] for state in self.tick()["standby"]))  # type: ignore[attr-defined]

    def walk(self) -> None:
        """Ten steps of the policy."""
        number = self.feed.newest()
        assert self.intake.ask("start_locomotion", LONG).granted
        self.until(lambda: self.feed.newest() > number + 50)
        assert self.tick()["mode"] == Mode.LOCOMOTION


@contextmanager
def playing(folder: Path, *options: str) -> Iterator[Session]:
    results = ("--viewer", "none", "--video", "none", "--record", "r.mcap", "--summary", "s.json")
    command = [sys.executable, "-m", "humanoid_sim.play", "--script", "hold 1000", *options, *results]
    with ExitStack() as stack:
        out = stack.enter_context(open(folder / "out.txt", "wb"))
        process = stack.enter_context(
            subprocess.Popen(command, cwd=folder, stdin=subprocess.DEVNULL, stdout=out, stderr=out)
        )
        stack.callback(process.kill)
        deadline = time.monotonic() + LONG
        while not running_sessions():
            assert process.poll() is None, (folder / "out.txt").read_text(encoding="utf-8")
            assert time.monotonic() < deadline, "it never came"
            time.sleep(0.02)
        info = find_session()
        feed, intake = stack.enter_context(Feed(info)), stack.enter_context(Intake(info, "test"))
        yield Session(process, feed, intake, folder)


def quit_and_replay(session: Session, capfd: pytest.CaptureFixture[str]) -> tuple[list[TickRecord], list[Event]]:
    assert session.intake.ask("quit", LONG).granted
    session.process.wait(LONG)
    capfd.readouterr()
    assert run_program(replay.main, [str(session.folder / "r.mcap"), "--infer"]) == 0
    assert "bit for bit identical\n" in capfd.readouterr().out
    entries = list(open_recording(session.folder / "r.mcap").entries())
    return [one for one in entries if isinstance(one, TickRecord)], [one for one in entries if isinstance(one, Event)]
