"""Small stand-ins for everything around the control loop; all write into one log, so that order can be checked."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import rig

from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.messages import (
    Event,
    EventKind,
    Intent,
    SafetyStatus,
    SessionHeader,
    TickOutput,
    TickRecord,
)
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.session.pace import LoopSettings
from humanoid_sim.session.session import Session

HEADER = SessionHeader("fake", rig.JOINTS, rig.PERIOD, 0)


class BrokenError(Exception):
    """What the fakes raise."""


@dataclass
class FakeRobot:
    """Three joints that never move by themselves; `on_read` and `on_write` are called with the number of the call."""

    log: list[str] = field(default_factory=list)
    on_read: Callable[[int], None] = lambda _: None
    on_write: Callable[[int], None] = lambda _: None
    velocity: float = 0.0
    """rad/s, of the first joint."""
    on_activate: Callable[[], object] = lambda: None
    activation_error: Exception | None = None
    extern: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.reads = 0
        self.writes = 0
        self.commands: list[MITCommand] = []
        self.is_closed = False

    @property
    def joints(self) -> tuple[str, ...]:
        return rig.JOINTS

    def activate(self) -> None:
        self.log.append("activate")
        self.on_activate()
        if self.activation_error:
            raise self.activation_error

    def read(self) -> tuple[MITState, tuple[SafetyStatus, ...]]:
        self.log.append("read")
        self.reads += 1
        self.on_read(self.reads - 1)
        velocity = np.array([self.velocity, 0.0, 0.0])
        return rig.state(self.writes * rig.PERIOD, joint_velocity=velocity, extern=self.extern), ()

    def write(self, command: MITCommand) -> None:
        self.log.append("write")
        self.writes += 1
        assert not self.is_closed
        self.on_write(self.writes - 1)
        self.commands.append(command)

    def close(self) -> None:
        self.log.append("close robot")
        self.is_closed = True


@dataclass
class FakeSource:
    """Gives the intents of a tick by its number; `finish_at` is the first poll after which it wants to end."""

    intents: Mapping[int, Sequence[Intent]] = field(default_factory=dict)
    finish_at: int = 10**9
    log: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.polls = 0
        self.seen: list[tuple[float, TickOutput | None]] = []

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        self.log.append("poll")
        self.seen.append((time, output))
        self.polls += 1
        return self.intents.get(self.polls - 1, ())

    @property
    def finished(self) -> bool:
        return self.polls > self.finish_at


@dataclass
class FakeSink:
    """Keeps what it gets; `on_tick` is called with each record."""

    log: list[str] = field(default_factory=list)
    on_tick: Callable[[TickRecord], None] = lambda _: None
    name: str = "sink"

    def __post_init__(self) -> None:
        self.records: list[TickRecord] = []
        self.events: list[str] = []
        self.kinds: list[EventKind] = []
        self.waiting: list[int] = []
        """Backlogs to report, one per question; 0 after the last."""
        self.questions = 0

    def start(self, header: SessionHeader) -> None:
        self.log.append(f"start {self.name}")

    def tick(self, record: TickRecord) -> None:
        self.log.append("hand out")
        self.on_tick(record)
        self.records.append(record)

    def event(self, event: Event) -> None:
        self.events.append(event.text)
        self.kinds.append(event.kind)

    backlog_limit = 2000

    @property
    def backlog(self) -> int:
        self.questions += 1
        return self.waiting.pop(0) if self.waiting else 0

    def close(self) -> None:
        self.log.append(f"close {self.name}")


def session(robot: Any, *, supervisor: Supervisor | None = None, **options: Any) -> Session:
    """A session that does not keep real time, unless told to."""
    loop = {name: options.pop(name) for name in ("realtime", "duration", "damping_time", "punctual") if name in options}
    settings = LoopSettings(rig.PERIOD, **{"realtime": False, "damping_time": 2.0, **loop})
    return Session(robot, supervisor or rig.supervisor(), settings, header=HEADER, **options)
