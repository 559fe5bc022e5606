"""Input and output of a front end: the ticks of a session on this machine, or of a robot elsewhere."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from functools import cached_property
from typing import Any, NamedTuple

import mujoco
import numpy as np

from humanoid_sim.client import Feed, Intake, SessionError, SessionInfo, find_session, monotonic_ns
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.messages import SessionHeader, TickRecord
from humanoid_sim.mit import COMMAND_FIELDS, FloatArray, IndexArray, MITCommand
from humanoid_sim.recording.codec import decode_tick
from humanoid_sim.recording.header import parse_header
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.ros2.cdr import CdrError
from humanoid_sim.session.feed import MODEL_BLOB
from humanoid_sim.session.realtime import punctual_threads

_LATE = 0.2  # s after which a tick is the past, or three control periods
_BEHIND = 30  # priorities behind the control loop, and behind all its threads


class Tick(NamedTuple):
    """A tick, and its arrival."""

    record: TickRecord
    stamp: int  # CLOCK_MONOTONIC ns

    @property
    def age(self) -> float:
        """Age in seconds."""
        return 1e-9 * (monotonic_ns() - self.stamp)


class Source:
    """Ticks of a robot, and what interprets them."""

    header: SessionHeader
    latest: Tick | None = None  # newest tick that `ticks` has returned
    is_hardware = False

    def ticks(self, timeout: float = 0.0) -> list[Tick]:
        """Return the ticks that are new since the last call; waits up to `timeout` s for one."""
        raise NotImplementedError

    def model(self) -> mujoco.MjModel:
        """Return a new copy of the robot's compiled model."""
        raise NotImplementedError

    def is_running(self) -> bool:
        """Return True while more ticks may come."""
        return True

    def status(self) -> Mapping[str, Any]:
        """Return what a session sends beside its ticks, twice a second."""
        return {}

    @cached_property
    def description(self) -> RobotDescription:
        return RobotDescription.from_json(self.header.documents["robot"])

    def lateness(self) -> str:
        """Return what a viewer must show if the newest tick is not the present; empty if it is."""
        age = 0.0 if self.latest is None else self.latest.age
        return f"BEHIND: this was {age:.1f} s ago" if age > max(_LATE, 3 * self.header.control_period) else ""


class Attachment(Source):
    """A session of this machine."""

    def __init__(self, session: SessionInfo, feed: Feed, intake: Intake) -> None:
        """Begin with the newest tick. Raises `InputError` for a session of another version."""
        self.session, self._feed, self.intake = session, feed, intake
        self.is_hardware = bool(session.hardware)
        self.live_inputs: Mapping[str, int] = feed.live_inputs
        """Names and widths of those that the session receives from other programs."""
        fields, documents = feed.header["session"], feed.header["documents"]
        blobs = {name: feed.blob(name) for name in json.loads(fields["attachments"])}
        self.header = parse_header(str(session), fields, documents, blobs)
        self._number = 0

    def __str__(self) -> str:
        return str(self.session)

    def ticks(self, timeout: float = 0.0) -> list[Tick]:
        if timeout > 0.0:
            self._feed.wait(self._number, timeout)
        samples = self._feed.since(self._number)
        with blaming(f"{self.session}: a tick of another version", CdrError):
            ticks = [Tick(decode_tick(sample.data), sample.stamp) for sample in samples]
        if samples:
            self._number, self.latest = samples[-1].number, ticks[-1]
        return ticks

    def model(self) -> mujoco.MjModel:
        with blaming(f"{self.session}: its model cannot be loaded", (ValueError, mujoco.FatalError)):
            return mujoco.MjModel.from_binary_path(MODEL_BLOB, {MODEL_BLOB: self._feed.blob(MODEL_BLOB)})

    def is_running(self) -> bool:
        return self._feed.is_running()

    def status(self) -> Mapping[str, Any]:
        return self._feed.status()

    def send(self, command: MITCommand, stamp: int) -> bool:
        """Send a command for REMOTE; `stamp` (ns) is when what it is made of arrived. True if sent."""
        fields = (getattr(command, name).tolist() for name in COMMAND_FIELDS)
        return self.intake.remote(self.header.joint_names, *fields, stamp=stamp)


def shown_qpos(record: TickRecord, qpos: FloatArray, joints: IndexArray) -> FloatArray:
    """Return the pose of a tick, shape (nq,): as simulated, or `qpos` with the joints, at `joints`, that are known."""
    if record.qpos is not None:
        return record.qpos
    position, pose = record.input.state.joint_position, qpos.copy()
    known = np.isfinite(position)
    pose[joints[known]] = position[known]
    return pose


@contextmanager
def attached(session: int | None, producer: str, *, niceness: int = 5) -> Iterator[Attachment]:
    """Attach to a running session, as a process that goes behind the control loop's other ones.

    Raises `InputError` if there is no such session.
    """
    try:
        info = find_session(session)
        with Feed(info) as feed, Intake(info, producer) as intake:
            os.nice(niceness)
            yield Attachment(info, feed, intake)
    except SessionError as error:
        raise InputError(str(error)) from None


def run_steps(attachment: Attachment, step: Callable[[], list[str]], period: float) -> None:
    """Step every `period` s until the session ends, and print the lines of each step.

    On hardware no other program keeps the device waiting: it would look lost, and a DAMP come late.
    """
    with punctual_threads(behind=_BEHIND) if attachment.is_hardware else nullcontext(), suppress(SessionError):
        while attachment.is_running():
            for line in step():
                print(line, flush=True)
            time.sleep(period)
