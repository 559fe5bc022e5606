"""A session that begins without a policy, from outside: `play` in a process of its own, its feed and its intake."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import fates
import pytest
from waiting import until

from humanoid_sim import replay
from humanoid_sim.cli import run_program
from humanoid_sim.client import Intake
from humanoid_sim.messages import Event, Mode, TickRecord
from humanoid_sim.recording.reader import open_recording

__all__ = ["LONG", "Session", "playing", "quit_and_replay"]

LONG = 120.0
"""s for anything that only has to happen."""


class Session(fates.Played):
    """`play` in a process of its own."""

    @property
    def intake(self) -> Intake:
        return self.operator

    def until(self, condition: Callable[[], object]) -> None:
        def is_so() -> object:
            assert self.process.poll() is None, self.said
            return condition()

        until(is_so, LONG)

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
    with fates.playing(folder, "--script", "hold 1000", *options) as play:
        yield Session(**vars(play))


def quit_and_replay(session: Session, capfd: pytest.CaptureFixture[str]) -> tuple[list[TickRecord], list[Event]]:
    assert session.intake.ask("quit", LONG).granted
    session.process.wait(LONG)
    capfd.readouterr()
    assert run_program(replay.main, [str(session.folder / "r.mcap"), "--infer"]) == 0
    assert "bit for bit identical\n" in capfd.readouterr().out
    entries = list(open_recording(session.folder / "r.mcap").entries())
    return [one for one in entries if isinstance(one, TickRecord)], [one for one in entries if isinstance(one, Event)]
