"""Robstride motors on open channels: the latest of each, and questions to many at once with their answers.

Receiver threads write, the control thread reads, and neither waits for the other: each slot is written by the one
receiver thread of its channel, only ever by assigning whole objects.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from humanoid_sim.hardware.can_bus import NEVER, Frame, Note, OpenChannels
from humanoid_sim.hardware.motor_link import MotorGroup, Readings
from humanoid_sim.hardware.robstride.firmware import FirmwareVersion
from humanoid_sim.hardware.robstride.parameters import Parameter, pack_value, unpack_value
from humanoid_sim.hardware.robstride.protocol import (
    BROADCAST_ID,
    CLEAR_FAULTS,
    DEFAULT_HOST_ID,
    READ_VERSION,
    DeviceId,
    FaultReport,
    FrameType,
    Ignored,
    Malformed,
    MotorMode,
    ParameterReply,
    Reply,
    Status,
    Version,
    decode_reply,
    encode_command,
    flag_names,
    parameter_data,
    split_identifier,
    type_name,
)

_COMMANDS = frozenset(FrameType) - {FrameType.GET_DEVICE_ID, FrameType.READ_PARAMETER}  # others may only scan and read


class Sample(NamedTuple):
    """A status and when it came, s, robot's clock."""

    time: float
    status: Status


@dataclass(slots=True)
class MotorSlot:
    """Data received from one motor. Written by one receiver thread."""

    sample: Sample | None = None
    report: FaultReport | None = None
    invalid: Note = NEVER  # the latest frame that could not be read

    @property
    def runs(self) -> bool:
        """Return whether its latest status reports run mode and no fault."""
        return self.sample is not None and self.sample.status.mode is MotorMode.RUN and not self.sample.status.faults

    @property
    def mode_text(self) -> str:
        """Return mode and faults of its latest status: `mode reset, undervoltage`."""
        if self.sample is None:
            return "no status"
        status = self.sample.status
        return ", ".join([f"mode {status.mode.name.lower()}", *flag_names(status.faults)])


_ANSWER_TIMES = (0.05, 0.1, 0.2, 0.4)  # s that a motor has to answer each request: a lost frame, a busy computer
_POLL = 0.001  # s
_LIFETIME = 0.06  # s in which what makes a motor move must leave, or it never does; other frames may be late
_WRITES = 4  # times that a value is written before what is read back counts
_MOST_ANSWERS = 4096  # that wait for `take_answers`
Answer = TypeVar("Answer")


class RobstrideLink:
    """Motors on open channels, each known by its index. Its `receive` must be given every frame of no other family.

    What asks waits for the answers, while nothing is moving, and never raises; motors that do not answer are left out.
    """

    def __init__(self, line: OpenChannels, motors: MotorGroup) -> None:
        self.line = line
        self.sources = line.sources
        self.expect(motors)

    def expect(self, motors: MotorGroup) -> None:
        """Talk to these motors from here on; everything received from others is forgotten."""
        self.motors = motors
        self.slots = tuple(MotorSlot() for _ in range(motors.count))
        self._answers: deque[tuple[int, Reply]] = deque(maxlen=_MOST_ANSWERS)  # with their channel
        self._index = {(motors.channel[i], motors.motor_id[i]): i for i in range(motors.count)}
        self._models = [
            {motors.motor_id[i]: motors.model[i] for i in motors.on_channel(channel)}
            for channel in range(len(self.line.channels))
        ]
        for each in self.line.channels:
            each.forget_strangers()

    # --- receiver threads

    def receive(self, channel: int, frame: Frame, time: float) -> bool:
        """Take a frame, whatever it is; True."""
        bus, (kind, _, sender, destination) = self.line.channels[channel], split_identifier(frame.arbitration_id)
        # A fault is a fault, whomever the motor reports it to: the manuals do not say where unasked reports go.
        host_id = destination if kind == FrameType.FAULT_REPORT else DEFAULT_HOST_ID
        reply = decode_reply(frame, self._models[channel], host_id)
        index = self._index.get((channel, sender))
        slot = None if index is None else self.slots[index]
        match reply:
            case Ignored("host_command") if kind in _COMMANDS and (channel, destination) in self._index:
                bus.intruder = Note(time, f"another host sends '{type_name(kind)}' to motor {destination}")
            case Ignored("other_host") if slot is not None and kind == FrameType.STATUS:
                # Another host commands it, or its own id is stored in it: commands do not name their host.
                bus.intruder = Note(time, f"motor {sender} answers host {destination}, not {DEFAULT_HOST_ID}")
            case Ignored("unknown_type" | "host_command") if slot is not None and destination in (
                DEFAULT_HOST_ID,
                BROADCAST_ID,
            ):
                slot.invalid = Note(time, f"frame of communication type {kind}")
            case Ignored("standard_id"):
                bus.strangers["frame with an 11-bit identifier"] += 1
            case Ignored(reason):
                bus.strangers[reason.replace("_", " ")] += 1
            case Malformed() if slot is not None:
                slot.invalid = Note(time, reply.reason)
            case FaultReport() if slot is not None:
                slot.report = reply
            case DeviceId() | ParameterReply() | Version() | Status():
                self._answers.append((channel, reply))
                if isinstance(reply, Status) and slot is not None:
                    slot.sample = Sample(time, reply)
        return True

    # --- control thread

    def readings(self) -> Readings:
        """Return the latest status of every motor."""
        rows = np.full((self.motors.count, len(Readings._fields)), np.nan)
        for row, slot in zip(rows, self.slots, strict=True):
            if slot.sample is not None:
                time, status = slot.sample
                row[:] = time, status.position, status.velocity, status.effort, status.temperature
        return Readings(*rows.T)

    # --- questions

    def frame(self, motor: int, kind: FrameType, data: bytes = b"") -> Frame:
        """Return the frame of a command to a motor."""
        return encode_command(kind, self.motors.motor_id[motor], data)

    def send(self, frames: Mapping[int, Sequence[Frame]]) -> None:
        """Send frames to motors, those of one motor in order; motors take turns.

        Where an earlier round is still waiting to leave, this one takes its place.
        """
        longest = max((len(group) for group in frames.values()), default=0)
        for step in range(longest):
            for motor, group in frames.items():
                if step < len(group):
                    frame = group[step]
                    moves = frame.arbitration_id >> 24 in (FrameType.ENABLE, FrameType.OPERATION_CONTROL)
                    key = (frame.arbitration_id if moves else frame, step)
                    channel = self.line.channels[self.motors.channel[motor]]
                    channel.send([(key, frame)], _LIFETIME if moves else math.inf)

    def take_answers(self) -> list[tuple[int, Reply]]:
        """Return motor and answer of every answer that has come since; waits for none."""
        found = []
        while self._answers:
            channel, reply = self._answers.popleft()
            motor = self._index.get((channel, reply.motor_id))
            if motor is not None:
                found.append((motor, reply))
        return found

    def ask(
        self,
        frames: Mapping[int, Sequence[Frame]],
        accept: Callable[[int, Reply], Answer | None],  # None: another answer than the wanted one
        patience: Sequence[float] | None = None,  # s to wait for answers, each time that it asks
        *,
        takes_late: bool = False,  # answers to earlier questions count
    ) -> dict[int, Answer]:
        """Send each motor's frames and collect one answer per motor."""
        found: dict[int, Answer] = {}
        for wait in patience or _ANSWER_TIMES:
            missing = {motor: group for motor, group in frames.items() if motor not in found}
            if not missing:
                break
            if not takes_late:
                self._answers.clear()
            self.send(missing)
            deadline = time.monotonic() + wait
            while True:
                for motor, reply in self.take_answers():
                    if motor in missing and (answer := accept(motor, reply)) is not None:
                        found[motor] = answer
                if len(found) == len(frames) or time.monotonic() >= deadline:
                    break
                time.sleep(_POLL)
        return found

    def until_status(
        self, frames: Mapping[int, Sequence[Frame]], wanted: Callable[[Status], bool]
    ) -> dict[int, Status]:
        """Send each motor's frames until a status that came afterwards is as wanted."""
        return self.ask(frames, lambda _, reply: reply if isinstance(reply, Status) and wanted(reply) else None)

    def stop_motors(self, motors: Iterable[int], *, clear_faults: bool = False) -> tuple[int, ...]:
        """Stop motors, and clear their faults on request; returns those that did not confirm it."""
        frames = {i: [self.frame(i, FrameType.STOP, CLEAR_FAULTS if clear_faults else b"")] for i in motors}
        confirmed = self.until_status(frames, lambda status: status.mode is MotorMode.RESET)
        return tuple(i for i in frames if i not in confirmed)

    def read_versions(self, motors: Iterable[int]) -> dict[int, FirmwareVersion]:
        """Return motors' firmware; one that does not know the question takes it for a stop, and is left out."""
        frames = {i: [self.frame(i, FrameType.STOP, READ_VERSION)] for i in motors}
        return self.ask(frames, lambda _, reply: reply.version if isinstance(reply, Version) else None)

    def read_uids(self, motors: Iterable[int]) -> dict[int, bytes]:
        """Return motors' unique ids."""
        frames = {i: [self.frame(i, FrameType.GET_DEVICE_ID)] for i in motors}
        return self.ask(frames, lambda _, reply: reply.uid if isinstance(reply, DeviceId) else None)

    def scan(self, motor_ids: Sequence[int], quiet_time: float, pace: float = 0.0) -> list[tuple[int, DeviceId]]:
        """Ask these ids on every channel who is there; every answer with its channel, also second ones of one id.

        Nobody else is expected after `quiet_time` s without an answer; `pace`: s between two ids.
        """
        self._answers.clear()
        for motor_id in motor_ids:
            for each in self.line.channels:
                each.send([(None, encode_command(FrameType.GET_DEVICE_ID, motor_id))])
            time.sleep(pace)
        for each in self.line.channels:
            each.flush(1.0)
        found: list[tuple[int, DeviceId]] = []
        quiet_since = time.monotonic()
        while time.monotonic() - quiet_since < quiet_time:
            while self._answers:
                channel, reply = self._answers.popleft()
                if isinstance(reply, DeviceId):
                    found.append((channel, reply))
                    quiet_since = time.monotonic()
            time.sleep(_POLL)
        return found

    # --- parameters; those that a motor does not have are None

    def read(
        self, parameters: Mapping[int, Parameter], patience: Sequence[float] | None = None, *, takes_late: bool = False
    ) -> dict[int, float | None]:
        """Return a parameter of each motor.

        `takes_late`: late answers to earlier questions count, for what is read again and again: where a bus takes
        longer than `patience`, there is an old answer each time, and not none for ever.
        """
        frames = {i: [self._read_frame(i, parameter)] for i, parameter in parameters.items()}
        return self._values(frames, parameters, patience, takes_late=takes_late)

    def write(self, parameter: Parameter, values: Mapping[int, float]) -> dict[int, float | None]:
        """Write a value to each motor and read it back; what differs is written again: its frame was lost."""
        found: dict[int, float | None] = {}
        wrong = list(values)
        for _ in range(_WRITES):
            frames = {}
            for i in wrong:
                data = parameter_data(parameter.index, pack_value(parameter.type, values[i]))
                frames[i] = [self.frame(i, FrameType.WRITE_PARAMETER, data), self._read_frame(i, parameter)]
            found |= self._values(frames, dict.fromkeys(wrong, parameter))
            wrong = [i for i, value in found.items() if value is not None and not parameter.is_same(value, values[i])]
        return found

    def _read_frame(self, motor: int, parameter: Parameter) -> Frame:
        return self.frame(motor, FrameType.READ_PARAMETER, parameter_data(parameter.index))

    def _values(
        self,
        frames: Mapping[int, Sequence[Frame]],
        parameters: Mapping[int, Parameter],
        patience: Sequence[float] | None = None,
        *,
        takes_late: bool = False,
    ) -> dict[int, float | None]:
        def accept(motor: int, reply: Reply) -> tuple[float | None] | None:
            parameter = parameters[motor]
            if not isinstance(reply, ParameterReply) or reply.index != parameter.index:
                return None
            return (float(unpack_value(parameter.type, reply.payload)) if reply.is_success else None,)

        answers = self.ask(frames, accept, patience, takes_late=takes_late)
        return {motor: value for motor, (value,) in answers.items()}
