"""Attachment of a front end to a session: the feed as the package's own types, and the intake."""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import cached_property

import mujoco

from humanoid_sim.client import Feed, Intake, Sample, SessionError, SessionInfo, find_session
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.messages import Event, EventKind, SessionHeader, TickRecord
from humanoid_sim.mit import COMMAND_FIELDS, MITCommand
from humanoid_sim.recording.codec import decode_tick
from humanoid_sim.recording.header import HeaderError, parse_header
from humanoid_sim.rendering.ghost import ReferenceGhost
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.ros2.cdr import CdrError
from humanoid_sim.session.feed import MODEL_BLOB
from humanoid_sim.session.realtime import punctual_threads
from humanoid_sim.simulation.floating_base import BaseObserver
from humanoid_sim.stack import no_policy, recorded_contract, recorded_contracts, recorded_policy

_LATE = 0.2
"""s after which a tick is the past; at least `_LATE_TICKS` control periods."""
_LATE_TICKS = 3
_BEHIND = 30
"""Priorities behind the control loop, and behind all its threads."""
_STATUS_WITHIN = 0.5
"""s for which an attachment waits for the session's status."""
_LOOK_PERIOD = 0.5
"""s between two looks whether the session is still there."""


@dataclass
class Attachment:
    """A running session, as a front end sees it."""

    session: SessionInfo
    feed: Feed
    intake: Intake
    _start_time_ns: int = 0
    """Header's, as of when the loop began; 0 while it is not known."""

    @cached_property
    def header(self) -> SessionHeader:
        """Return what the run is, as its recording says it. Raises `InputError` for a feed of another version."""
        fields, documents = self.feed.header["session"], self.feed.header["documents"]
        names = json.loads(fields["attachments"])
        with blaming(self.session, HeaderError):
            return parse_header(fields, documents, {name: self.feed.blob(name) for name in names})

    @cached_property
    def description(self) -> RobotDescription:
        """The robot."""
        return RobotDescription.from_json(self.header.documents["robot"])

    @cached_property
    def contract(self) -> PolicyContract | None:
        """The policy's; None without one."""
        return recorded_contract(self.header)

    @property
    def walking_contract(self) -> PolicyContract | None:
        """Contract of the first policy that takes a velocity command; None if none does."""
        return next((one for one in recorded_contracts(self.header) if one.takes_velocity_command), None)

    @cached_property
    def base(self) -> BaseObserver | None:
        """Observer of a simulated floating base; None for a fixed one, and on hardware, which measures no position."""
        is_seen = self.description.is_floating and not self.session.hardware
        return BaseObserver(self.model(), self.description) if is_seen else None

    def reference_ghost(self) -> ReferenceGhost | None:
        """Return the motion that the policy follows, as poses of the robot; None where there is none that holds poses.

        Raises `InputError` if the header is damaged.
        """
        loaded = recorded_policy(self.header, no_policy)
        return None if loaded is None else ReferenceGhost.of(self.description, loaded.contract, loaded.reference)

    def model(self) -> mujoco.MjModel:
        """Give the robot's compiled model, of which the ticks' `qpos` is: a new one each time, to do with as one likes.

        Raises `InputError` if it was compiled by another version of MuJoCo.
        """
        with blaming(f"{self.session}: its model cannot be loaded", (ValueError, mujoco.FatalError)):
            return mujoco.MjModel.from_binary_path(MODEL_BLOB, {MODEL_BLOB: self.feed.blob(MODEL_BLOB)})

    def before_present(self) -> int:
        """Return the number of the tick before the newest: a front end that comes late begins with the present."""
        sample = self.feed.latest()
        return 0 if sample is None else sample.number - 1

    def looks(self, number: int, pause: float) -> Iterator[list[Sample]]:
        """Look at the feed until the session ends, every `pause` s; yields the ticks after that number that are new."""
        looked = time.monotonic()
        while True:
            new = self.feed.since(number)
            number = new[-1].number if new else number
            yield new
            if time.monotonic() - looked > _LOOK_PERIOD:
                looked = time.monotonic()
                if not self.feed.is_running():
                    return
            time.sleep(pause)

    def latest(self) -> tuple[Sample, TickRecord] | None:
        """Return the newest tick; None while there is none."""
        sample = self.feed.latest()
        return None if sample is None else (sample, self.record(sample))

    def send(self, command: MITCommand, stamp: int) -> bool:
        """Send a command for REMOTE, as old as what it is made of, ns; whether it left."""
        fields = (getattr(command, name).tolist() for name in COMMAND_FIELDS)
        return self.intake.remote(self.description.joint_names, *fields, stamp=stamp)

    def record(self, sample: Sample) -> TickRecord:
        """Return a sample of the ring `tick`."""
        with blaming(f"{self.session}: a tick of another version", CdrError):
            return decode_tick(sample.data)

    def time_ns(self, time: float) -> int:
        """Return ns since the Unix epoch of a time in s on the robot's clock; of no number, those of its zero."""
        self._start_time_ns = self._start_time_ns or int(self.feed.status().get("start_time_ns", 0))
        start = self._start_time_ns or self.header.start_time_ns
        return max(0, start + round(1e9 * time)) if math.isfinite(time) and abs(time) < 1e9 else start

    def events(self, number: int) -> Iterator[tuple[int, Event]]:
        """Yield numbers and events after that number, oldest first; 0 for all that the status still holds."""
        for count, when, text, kind in self.feed.status().get("events", ()):
            if count > number:
                yield count, Event(when, text, EventKind(kind))


@contextmanager
def attached(session: int | None, producer: str, *, niceness: int = 5) -> Iterator[Attachment]:
    """Attach to a running session. Raises `InputError` if there is no such session.

    Args:
        producer: the front end's name, for operators to read.
        niceness: by how much the control loop's other threads and processes go before this one.
    """
    try:
        info = find_session(session)
        with Feed(info) as feed, Intake(info, producer) as intake:
            os.nice(niceness)
            deadline = time.monotonic() + _STATUS_WITHIN
            while not feed.status() and time.monotonic() < deadline:
                time.sleep(0.005)
            yield Attachment(info, feed, intake)
    except SessionError as error:
        raise InputError(str(error)) from None


def steps(attachment: Attachment, step: Callable[[], list[str]]) -> Iterator[list[str]]:
    """Take steps until the session ends, and print their lines for an operator; yields the lines of each step.

    On hardware no other program keeps them waiting: the device would look lost, and a DAMP come late.
    """
    with punctual_threads(behind=_BEHIND) if attachment.session.hardware else nullcontext():
        while attachment.feed.is_running():
            try:
                lines = step()
            except SessionError:  # it has ended
                return
            for line in lines:
                print(line, flush=True)
            yield lines


def ready(serves: str) -> None:
    """Say that the front end works, and what it serves, such as an address: one line, which `play` shows too."""
    print(serves, flush=True)


def behind(age: float, control_period: float) -> str:
    """Return what a viewer must say of a tick that is not the present; empty for one that is.

    `age` is in s since the session wrote the tick, `control_period` in s between two ticks.
    """
    is_late = age > max(_LATE, _LATE_TICKS * control_period)
    return f"BEHIND: this was {age:.1f} s ago" if is_late else ""
