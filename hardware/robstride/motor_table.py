"""Data received from each motor. Receiver threads write, the control thread reads, and neither waits for the other.

Each slot is written by the one receiver thread of its channel and only ever by assigning whole objects, so the control
thread sees either the old sample or the new one. What may happen between two readings and be gone at the second (a
fault bit in one frame, a mode that fell and came back) is kept beside the latest sample, with its time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from humanoid_sim.hardware.bus.events import NEVER, ChannelNotes, Note
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.motors import MotorGroup, Readings
from humanoid_sim.hardware.robstride.codec import decode_reply
from humanoid_sim.hardware.robstride.messages import (
    BROADCAST_ID,
    DeviceId,
    FaultReport,
    FrameType,
    Identifier,
    Ignored,
    Malformed,
    MotorMode,
    Reply,
    Status,
    split_identifier,
)

Inbox = Callable[[int, Reply, float], None]
"""Takes an answer to a request: the channel it came from, the answer, its time (s, robot's clock)."""

_QUESTIONS = frozenset({FrameType.GET_DEVICE_ID, FrameType.READ_PARAMETER})
"""Frames that another host may send: a scan, a parameter read."""
_COMMANDS = frozenset(FrameType) - _QUESTIONS - {FrameType.STATUS, FrameType.FAULT_REPORT}
"""Frames that another host must not send to our motors."""


class Sample(NamedTuple):
    """A status and when it came."""

    time: float
    """s, robot's clock."""
    status: Status


@dataclass(slots=True)
class MotorSlot:
    """Data received from one motor. Written by one receiver thread."""

    joint: int
    sample: Sample | None = None
    alarm: Sample | None = None
    """The latest status that reported a fault or a mode other than RUN."""
    report: FaultReport | None = None
    invalid: Note = NEVER
    invalid_frames: int = 0
    statuses: int = 0
    """Answers to commands (type 2)."""
    reports: int = 0
    """Active reports (type 24)."""
    commanded: int = 0
    """Operation control frames handed to the channel; written by the control thread."""
    acknowledged: int = 0
    """Answers that had a command to answer."""
    answers_to: int | None = None
    """The other host to which it sent its latest stray status; none: it has sent none."""
    hides_timeout: bool = False
    """True if it does not tell its CAN timeout, which is tried out then."""


class MotorTable:
    """The slots of a group of motors."""

    def __init__(self, motors: MotorGroup, host_id: int, notes: Sequence[ChannelNotes]) -> None:
        """Start with nothing heard.

        Args:
            host_id: replies to this host are ours. A robot's is above 127, so that no motor can be taken for it.
            notes: by channel, takes what belongs to no motor.
        """
        self.slots = tuple(MotorSlot(i) for i in range(motors.count))
        self.inbox: Inbox | None = None
        """Takes answers to requests, on a receiver's thread; none: they are dropped."""
        self.counts_answers = True
        """True if a status acknowledges a command; False when something else is asked as well."""
        self.expects_strays = False
        """True if statuses to another host may be answers to this one, and so are not a sign of another master."""
        self._host_id = host_id
        self.notes = notes
        self._by_address = {(motors.channel[i], motors.motor_id[i]): slot for i, slot in enumerate(self.slots)}
        self._models = tuple(
            {motors.motor_id[i]: motors.model[i] for i in motors.on_channel(channel)} for channel in range(len(notes))
        )

    # --- receiver threads

    def receive(self, channel: int, frame: Frame, time: float) -> None:
        """Take a frame that came from a channel."""
        notes = self.notes[channel]
        if not frame.is_extended or frame.is_remote or frame.is_error:
            notes.add_stranger("remote frame" if frame.is_remote else "11-bit identifier", time)
            return
        parts = split_identifier(frame.arbitration_id)
        if parts.destination != self._host_id and (channel, parts.destination) in self._by_address:
            self._take_command(notes, parts, time)
            return
        # A fault is a fault, whomever the motor tells: the manuals do not say where unasked reports go.
        host_id = parts.destination if parts.type == FrameType.FAULT_REPORT else self._host_id
        reply = decode_reply(frame, self._models[channel], host_id)
        slot = self._by_address.get((channel, parts.low))
        if slot is None:
            notes.add_stranger("frame of no motor of this robot", time)
            if isinstance(reply, DeviceId):
                self._answer(channel, reply, time)
        elif isinstance(reply, Status):
            self._take_status(slot, reply, time)
        elif isinstance(reply, FaultReport):
            slot.report = reply
        elif isinstance(reply, Malformed):
            self._invalid(slot, reply.reason, time)
        elif isinstance(reply, Ignored):
            self._take_ignored(notes, slot, reply, parts, time)
        else:
            self._answer(channel, reply, time)

    def _answer(self, channel: int, reply: Reply, time: float) -> None:
        if self.inbox is not None:
            self.inbox(channel, reply, time)

    def _take_command(self, notes: ChannelNotes, parts: Identifier, time: float) -> None:
        """Take in a command to one of our motors that we did not send."""
        if parts.type in _QUESTIONS:
            notes.add_stranger("another host's question", time)
        elif parts.type in _COMMANDS:
            notes.intrusions += 1
            sender = "another host" if parts.type == FrameType.OPERATION_CONTROL else f"host 0x{parts.low:02X}"
            name = FrameType(parts.type).name.lower().replace("_", " ")
            notes.intruder = Note(time, f"{sender} sends '{name}' to motor {parts.destination}")
        else:
            notes.add_stranger("unknown communication type", time)

    def _take_status(self, slot: MotorSlot, status: Status, time: float) -> None:
        sample = Sample(time, status)
        if status.faults or status.mode is not MotorMode.RUN:
            slot.alarm = sample
        slot.sample = sample
        if status.is_report:
            slot.reports += 1
        else:
            slot.statuses += 1
            slot.acknowledged += self.counts_answers and slot.acknowledged < slot.commanded

    def _take_ignored(
        self, notes: ChannelNotes, slot: MotorSlot, reply: Ignored, parts: Identifier, time: float
    ) -> None:
        """Take in a frame of one of our motors that says nothing to this host."""
        if parts.type == FrameType.STATUS:
            slot.answers_to = parts.destination
            if self.expects_strays:
                return
            notes.intrusions += 1
            text = f"motor {parts.low} answers host 0x{parts.destination:02X}, not 0x{self._host_id:02X}"
            notes.intruder = Note(time, text)
        elif parts.type == FrameType.ACTIVE_REPORT:  # switched on by a host that may be long gone
            notes.add_stranger("report to another host", time)
        elif parts.destination in {self._host_id, BROADCAST_ID}:
            self._invalid(slot, f"frame of communication type {parts.type}", time)
        else:
            notes.add_stranger(reply.reason.value, time)

    @staticmethod
    def _invalid(slot: MotorSlot, text: str, time: float) -> None:
        slot.invalid_frames += 1
        slot.invalid = Note(time, text)

    # --- control thread

    def count_commands(self) -> None:
        """Expect an acknowledgement from every motor."""
        for slot in self.slots:
            slot.commanded += 1

    def readings(self) -> Readings:
        """Return the latest status of every motor."""
        rows = [_UNHEARD if (sample := slot.sample) is None else _row(sample) for slot in self.slots]
        return Readings(*np.array(rows).reshape(-1, len(_UNHEARD)).T)


_UNHEARD = (float("nan"),) * 5


def _row(sample: Sample) -> tuple[float, ...]:
    status = sample.status
    return sample.time, status.position, status.velocity, status.effort, status.temperature
