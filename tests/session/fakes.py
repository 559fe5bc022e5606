"""Small stand-ins for everything around the control loop; all write into one log, so that order can be checked."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import rig

from humanoid_sim.messages import Event, EventKind, Intent, SafetyStatus, SessionHeader, TickOutput, TickRecord
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.session.pace import LoopSettings
from humanoid_sim.session.session import Session

HEADER = SessionHeader("fake", rig.JOINTS, rig.PERIOD, 0)


@dataclass
class FakeRobot:
    """Three joints that never move."""

    joints = rig.JOINTS
    log: list[str] = field(default_factory=list)
    on_activate: Callable[[], object] = lambda: None
    time: float = 0.0
    safety: tuple[SafetyStatus, ...] = ()

    def activate(self) -> None:
        self.log.append("activate")
        self.on_activate()

    def read(self) -> tuple[MITState, tuple[SafetyStatus, ...]]:
        return rig.state(self.time), self.safety

    def write(self, command: MITCommand) -> None:
        self.time += rig.PERIOD

    def close(self) -> None:
        self.log.append("close robot")


@dataclass
class FakeSource:
    """Gives the intents of a tick by its number."""

    intents: Mapping[int, Sequence[Intent]] = field(default_factory=dict)
    finished = False
    polls: int = 0

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        self.polls += 1
        return self.intents.get(self.polls - 1, ())


@dataclass
class FakeSink:
    """Keeps what it gets; `on_tick` is called with each record."""

    log: list[str] = field(default_factory=list)
    on_tick: Callable[[TickRecord], None] = lambda _: None
    name: str = "sink"
    records: list[TickRecord] = field(default_factory=list)
    events: list[tuple[str, EventKind]] = field(default_factory=list)

    def start(self, header: SessionHeader) -> None:
        self.log.append(f"start {self.name}")

    def tick(self, record: TickRecord) -> None:
        self.on_tick(record)
        self.records.append(record)

    def event(self, event: Event) -> None:
        self.events.append((event.text, event.kind))

    def close(self) -> None:
        self.log.append(f"close {self.name}")


def session(robot: Any, *, duration: float | None = None, **options: Any) -> Session:
    """A session that does not keep real time."""
    settings = LoopSettings(rig.PERIOD, realtime=False, duration=duration)
    return Session(robot, rig.supervisor(), settings, header=HEADER, **options)
