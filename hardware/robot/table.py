"""What was heard of each motor. Receiver threads write, the control thread reads, and neither waits for the other.

Each slot is written by the one receiver thread of its channel and only ever by assigning whole objects, so the control
thread sees either the old sample or the new one. What may happen between two readings and be gone at the second (a
fault bit in one frame, a mode that fell and came back) is kept beside the latest sample, with its time.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.robot.wiring import Wiring
from humanoid_sim.hardware.robstride.faults import MotorMode
from humanoid_sim.hardware.robstride.frames import BROADCAST_ID, FrameType, split_identifier
from humanoid_sim.hardware.robstride.messages import (
    DeviceId,
    FaultReport,
    Ignored,
    Malformed,
    Reply,
    Version,
)
from humanoid_sim.hardware.robstride.replies import VERSION_MARK, decode_reply
from humanoid_sim.hardware.robstride.scale import SIGNED_STEPS
from humanoid_sim.mit import FloatArray

__all__ = ["MotorSlot", "MotorTable", "Note", "Readings", "Sample", "nothing_heard"]

Inbox = Callable[[int, Reply, float], None]
"""Takes an answer to a request: the channel it came from, the answer, its time (s, robot's clock)."""

_STATUS_DATA = struct.Struct(">HHHH")
_VERSION_LENGTH = 7
"""Bytes of a version reply at least; the English manuals have 8."""
_STATUS_TYPES = frozenset({FrameType.STATUS, FrameType.ACTIVE_REPORT})
_COMMANDS = frozenset(
    {
        FrameType.OPERATION_CONTROL,
        FrameType.ENABLE,
        FrameType.STOP,
        FrameType.SET_ZERO,
        FrameType.SET_DEVICE_ID,
        FrameType.WRITE_PARAMETER,
        FrameType.SAVE_PARAMETERS,
        FrameType.SET_BAUD_RATE,
        FrameType.ACTIVE_REPORT,
        FrameType.SET_PROTOCOL,
    }
)
"""What another host must not send to our motors."""
_QUESTIONS = frozenset({FrameType.GET_DEVICE_ID, FrameType.READ_PARAMETER})
"""What another host may: a scan, a parameter read."""
_LARGEST_MOTOR_ID = 127


class Sample(NamedTuple):
    """One status frame, undecoded."""

    time: float
    """s, robot's clock."""
    position: int
    velocity: int
    effort: int
    temperature: int
    """0.1 °C"""
    mode: int
    faults: int


class Note(NamedTuple):
    """Something that happened."""

    time: float
    """s, robot's clock."""
    text: str


_NEVER = Note(-float("inf"), "")


@dataclass(slots=True)
class MotorSlot:
    """What was heard of one motor. Written by one receiver thread."""

    joint: int
    sample: Sample | None = None
    """The latest status."""
    alarm: Sample | None = None
    """The latest status that reported a fault or a mode other than RUN."""
    report: FaultReport | None = None
    """The latest fault report."""
    invalid: Note = _NEVER
    """The latest frame that could not be read."""
    invalid_frames: int = 0
    statuses: int = 0
    """Answers to commands (type 2)."""
    reports: int = 0
    """Active reports (type 24)."""
    announcements: int = 0
    """Device ids."""
    commanded: int = 0
    """Operation control frames handed to the channel; written by the control thread."""
    acknowledged: int = 0
    """Answers that had a command to answer."""


@dataclass(slots=True)
class ChannelNotes:
    """What was heard on one channel that belongs to none of its motors."""

    intruder: Note = _NEVER
    """The latest sign of another host that commands our motors."""
    intrusions: int = 0
    strangers: Counter[str] = field(default_factory=Counter)
    """Frames that concern none of our motors, by what they are."""


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """The latest status of every motor, decoded; NaN for one that was never heard. Shape (n,) each, motor frame."""

    time: FloatArray
    """s, robot's clock."""
    position: FloatArray
    """rad, within ±4π."""
    velocity: FloatArray
    """rad/s"""
    effort: FloatArray
    """N·m"""
    temperature: FloatArray
    """°C"""


class MotorTable:
    """The slots of all motors of a robot."""

    def __init__(self, wiring: Wiring, host_id: int, channel_count: int) -> None:
        """Start with nothing heard.

        Args:
            wiring: joints and motors.
            host_id: replies to this host are ours; above 127, so that no motor can be taken for it.
            channel_count: channels that frames come from.
        """
        self.slots = tuple(MotorSlot(i) for i in range(wiring.count))
        self.channels = tuple(ChannelNotes() for _ in range(channel_count))
        self.inbox: Inbox | None = None
        """Takes answers to requests, on a receiver's thread; none: they are dropped."""
        self.counts_answers = True
        """Whether a status acknowledges a command; not when something else is asked as well."""
        self._host_id = host_id
        self._by_address = {(wiring.channel[i], wiring.motor_id[i]): slot for i, slot in enumerate(self.slots)}
        self._models = tuple(
            {wiring.motor_id[i]: wiring.model[i] for i in wiring.on_channel(channel)}
            for channel in range(channel_count)
        )
        self._range = np.array([(m.position, m.velocity, m.effort) for m in wiring.model]).T

    # --- receiver threads

    def receive(self, channel: int, frame: Frame, time: float) -> None:
        """Take a frame that came from a channel."""
        notes = self.channels[channel]
        if not frame.is_extended or frame.is_remote or frame.is_error:
            notes.strangers["remote frame" if frame.is_remote else "11-bit identifier"] += 1
            return
        kind, _, low, destination = split_identifier(frame.arbitration_id)
        if destination <= _LARGEST_MOTOR_ID and (channel, destination) in self._by_address:
            self._take_command(channel, kind, low, destination, time)
            return
        slot = self._by_address.get((channel, low))
        if slot is None:
            self._take_stranger(channel, frame, kind, time)
        elif kind in _STATUS_TYPES:
            self._take_status(channel, slot, frame, time)
        else:
            self._take_other(channel, slot, frame, time)

    def _take_command(self, channel: int, kind: int, host: int, motor_id: int, time: float) -> None:
        """A command to one of our motors that we did not send."""
        notes = self.channels[channel]
        if kind in _QUESTIONS:
            notes.strangers["another host's question"] += 1
        elif kind in _COMMANDS:
            notes.intrusions += 1
            sender = "another host" if kind == FrameType.OPERATION_CONTROL else f"host 0x{host:02X}"
            name = FrameType(kind).name.lower().replace("_", " ")
            notes.intruder = Note(time, f"{sender} sends '{name}' to motor {motor_id}")
        else:
            notes.strangers["unknown communication type"] += 1

    def _take_stranger(self, channel: int, frame: Frame, kind: int, time: float) -> None:
        self.channels[channel].strangers["frame of no motor of this robot"] += 1
        if kind == FrameType.GET_DEVICE_ID and self.inbox is not None:
            reply = decode_reply(frame, self._models[channel], self._host_id)
            if isinstance(reply, DeviceId):
                self.inbox(channel, reply, time)

    def _take_status(self, channel: int, slot: MotorSlot, frame: Frame, time: float) -> None:
        kind, high, low, destination = split_identifier(frame.arbitration_id)
        data = frame.data
        if destination != self._host_id:
            self._take_foreign_status(channel, kind, low, destination, time)
        elif data[:3] == VERSION_MARK and len(data) >= _VERSION_LENGTH:
            # Whoever asked and whenever: read as a status, it would put the joint at -12.49 rad.
            if self.inbox is not None:
                self.inbox(channel, Version(low, destination, (data[3], data[4], data[5], data[6])), time)
        elif len(data) != _STATUS_DATA.size:
            self._invalid(slot, f"status with {len(data)} bytes, expected {_STATUS_DATA.size}", time)
        else:
            position, velocity, effort, temperature = _STATUS_DATA.unpack(data)
            sample = Sample(time, position, velocity, effort, temperature, high >> 6, high & 0x3F)
            if sample.faults or sample.mode != MotorMode.RUN:
                slot.alarm = sample
            slot.sample = sample
            if kind == FrameType.ACTIVE_REPORT:
                slot.reports += 1
            else:
                slot.statuses += 1
                slot.acknowledged += self.counts_answers and slot.acknowledged < slot.commanded

    def _take_foreign_status(self, channel: int, kind: int, motor_id: int, host: int, time: float) -> None:
        notes = self.channels[channel]
        if kind == FrameType.ACTIVE_REPORT:  # switched on by a host that may be long gone
            notes.strangers["report to another host"] += 1
            return
        notes.intrusions += 1
        notes.intruder = Note(time, f"motor {motor_id} answers host 0x{host:02X}, not 0x{self._host_id:02X}")

    def _take_other(self, channel: int, slot: MotorSlot, frame: Frame, time: float) -> None:
        kind, _, _, destination = split_identifier(frame.arbitration_id)
        # A fault is a fault, whomever the motor tells: the manuals do not say where unasked reports go.
        host_id = destination if kind == FrameType.FAULT_REPORT else self._host_id
        reply = decode_reply(frame, self._models[channel], host_id)
        if isinstance(reply, FaultReport):
            slot.report = reply
        elif isinstance(reply, Malformed):
            self._invalid(slot, reply.reason, time)
        elif isinstance(reply, Ignored):
            if destination in {self._host_id, BROADCAST_ID}:
                self._invalid(slot, f"frame of communication type {kind}", time)
            else:
                self.channels[channel].strangers[reply.reason.value] += 1
        else:
            slot.announcements += isinstance(reply, DeviceId)
            if self.inbox is not None:
                self.inbox(channel, reply, time)

    @staticmethod
    def _invalid(slot: MotorSlot, text: str, time: float) -> None:
        slot.invalid_frames += 1
        slot.invalid = Note(time, text)

    # --- control thread

    def count_commands(self, batch: Iterable[tuple[int, Frame]]) -> None:
        """Expect an acknowledgement from each of these joints' motors."""
        for joint, _ in batch:
            self.slots[joint].commanded += 1

    def readings(self) -> Readings:
        """The latest status of every motor, decoded with zero at raw 32767."""
        rows = [slot.sample or _UNHEARD for slot in self.slots]
        raw = np.array(rows, dtype=np.float64).T
        position, velocity, effort = (raw[1:4] / SIGNED_STEPS - 1.0) * self._range
        return Readings(raw[0], position, velocity, effort, raw[4] / 10.0)


_UNHEARD = (float("nan"),) * len(Sample._fields)


def nothing_heard(joint_count: int) -> Readings:
    """The readings before any motor was heard."""
    unknown = np.full(joint_count, np.nan)
    return Readings(unknown, unknown, unknown, unknown, unknown)
