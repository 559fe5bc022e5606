"""Robstride motors on open channels: what is received from each, and questions to many at once with their answers.

Receiver threads write, the control thread reads, and neither waits for the other: each slot is written by the one
receiver thread of its channel, only ever by assigning whole objects. What may be gone at the next reading (a fault bit
in one frame, a mode that fell and came back) is kept beside the latest sample, with its time.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from humanoid_sim.hardware.bus.channel import NEVER, Note
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.bus.open_channels import ChannelNotes, OpenChannels
from humanoid_sim.hardware.motor_link import MotorGroup, Readings
from humanoid_sim.hardware.robstride.codec import decode_reply, encode_command
from humanoid_sim.hardware.robstride.messages import (
    BROADCAST_ID,
    Command,
    DeviceId,
    Enable,
    FaultReport,
    FrameType,
    GetDeviceId,
    Identifier,
    Ignored,
    Malformed,
    MotorMode,
    OperationControl,
    ParameterReply,
    ReadParameter,
    Reply,
    Status,
    WriteParameter,
    flag_names,
    split_identifier,
)
from humanoid_sim.hardware.robstride.parameters import Parameter, pack_value, unpack_value
from humanoid_sim.robots.motors import MOTORS

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

    sample: Sample | None = None
    alarm: Sample | None = None
    """The latest status that reported a fault or a mode other than RUN."""
    report: FaultReport | None = None
    invalid: Note = NEVER
    """The latest frame that could not be read."""
    answers: int = 0
    """Statuses that answer something (type 2)."""
    reports: int = 0
    """Active reports (type 24)."""
    hides_timeout: bool = False
    """True if its CAN timeout cannot be read, which is tried out then."""

    @property
    def runs(self) -> bool:
        """Return whether its latest status reports run mode and no fault."""
        return self.sample is not None and self.sample.status.mode is MotorMode.RUN and not self.sample.status.faults

    @property
    def mode_text(self) -> str:
        """Return what its latest status says about mode and faults: `mode reset, undervoltage`."""
        if self.sample is None:
            return "no status"
        status = self.sample.status
        return ", ".join([f"mode {status.mode.name.lower()}", *flag_names(status.faults)])


@dataclass(frozen=True, slots=True)
class Unreadable:
    """A motor answered that it has no such parameter, or did not answer."""

    reason: str
    is_silent: bool = False
    """True if nothing came back."""


_ANSWER_TIMES = (0.05, 0.1, 0.2, 0.4)
"""s that a motor has to answer each request. It takes milliseconds; the first retries are for a lost
frame, the last for a busy computer."""
_POLL = 0.001  # s
_LIFETIME = 0.06  # s in which what makes a motor move must leave, or it never does; other frames may be late
_WRITES = 4  # times that a value is written before what is read back counts
_MOST_ANSWERS = 4096  # that wait for `take_answers`
_UNKNOWN_ROW = (math.nan,) * 5
Answer = TypeVar("Answer")


class RobstrideLink:
    """Motors on open channels, each known by its index. Its `receive` must be given every frame of no other family.

    What asks waits for the answers, while nothing is moving, and never raises.
    """

    def __init__(self, line: OpenChannels, motors: MotorGroup, host_id: int) -> None:
        """Send nothing yet. A robot's host id is above 127, so that it is no motor's."""
        self.line = line
        self.channels, self.sources = line.channels, line.sources
        self.host_id = host_id
        self.expect(motors)

    def expect(self, motors: MotorGroup) -> None:
        """Talk to these motors from here on; what was received from others is forgotten."""
        self.motors = motors
        self.slots = tuple(MotorSlot() for _ in range(motors.count))
        self._answers: deque[tuple[int, Reply]] = deque(maxlen=_MOST_ANSWERS)
        self._index = {(motors.channel[i], motors.motor_id[i]): i for i in range(motors.count)}
        self._models = tuple(
            {motors.motor_id[i]: motors.model[i] for i in motors.on_channel(channel)}
            for channel in range(len(self.channels))
        )
        self.line.forget_notes()

    # --- receiver threads

    def receive(self, channel: int, frame: Frame, time: float) -> bool:
        """Take a frame, whatever it is; True."""
        notes = self.line.notes[channel]
        if not frame.is_extended or frame.is_remote or frame.is_error:
            notes.add_stranger("remote frame" if frame.is_remote else "frame with an 11-bit identifier", time)
            return True
        parts = split_identifier(frame.arbitration_id)
        if parts.destination != self.host_id and (channel, parts.destination) in self._index:
            self._take_command(notes, parts, time)
            return True
        # A fault is a fault, whomever the motor reports it to: the manuals do not say where unasked reports go.
        host_id = parts.destination if parts.type == FrameType.FAULT_REPORT else self.host_id
        reply = decode_reply(frame, self._models[channel], host_id)
        index = self._index.get((channel, parts.low))
        if index is None:
            if isinstance(reply, DeviceId):
                self._answers.append((channel, reply))
            else:
                notes.add_stranger("frame of no motor of this robot", time)
            return True
        slot = self.slots[index]
        match reply:
            case Status():
                _take_status(slot, Sample(time, reply))
            case FaultReport():
                slot.report = reply
            case Malformed():
                slot.invalid = Note(time, reply.reason)
            case Ignored():
                self._take_ignored(notes, slot, reply, parts, time)
            case _:
                self._answers.append((channel, reply))
        return True

    def _take_command(self, notes: ChannelNotes, parts: Identifier, time: float) -> None:
        """Take in a command to one of our motors that we did not send."""
        if parts.type in _QUESTIONS:
            notes.add_stranger("another host's question", time)
        elif parts.type in _COMMANDS:
            sender = "another host" if parts.type == FrameType.OPERATION_CONTROL else f"host 0x{parts.low:02X}"
            name = FrameType(parts.type).name.lower().replace("_", " ")
            notes.intruder = Note(time, f"{sender} sends '{name}' to motor {parts.destination}")
        else:
            notes.add_stranger("unknown communication type", time)

    def _take_ignored(
        self, notes: ChannelNotes, slot: MotorSlot, reply: Ignored, parts: Identifier, time: float
    ) -> None:
        """Take in a frame of one of our motors that says nothing to this host."""
        if parts.type == FrameType.STATUS:
            # Another host commands it, or its own id is stored in it: commands do not name their host.
            text = f"motor {parts.low} answers host {parts.destination}, not {self.host_id}: --host-id?"
            notes.intruder = Note(time, text)
        elif parts.type == FrameType.ACTIVE_REPORT:  # switched on by a host that may be long gone
            notes.add_stranger("report to another host", time)
        elif parts.destination in {self.host_id, BROADCAST_ID}:
            slot.invalid = Note(time, f"frame of communication type {parts.type}")
        else:
            notes.add_stranger(reply.reason, time)

    # --- control thread

    @property
    def answers(self) -> int:
        """Statuses that answered something."""
        return sum(slot.answers for slot in self.slots)

    def readings(self) -> Readings:
        """Return the latest status of every motor."""
        rows = [_UNKNOWN_ROW if (sample := slot.sample) is None else _row(sample) for slot in self.slots]
        return Readings(*np.array(rows).reshape(-1, len(_UNKNOWN_ROW)).T)

    # --- questions

    def send(self, commands: Mapping[int, Sequence[Command]]) -> None:
        """Send commands to motors, those of one motor in order; motors take turns.

        Where an earlier round is still waiting to leave, this one takes its place.
        """
        longest = max((len(group) for group in commands.values()), default=0)
        for step in range(longest):
            for motor, group in commands.items():
                if step < len(group):
                    command = group[step]
                    frame = encode_command(command, self.motors.model[motor])
                    lifetime = _LIFETIME if isinstance(command, (Enable, OperationControl)) else math.inf
                    channel = self.channels[self.motors.channel[motor]]
                    channel.send([((type(command), self.motors.names[motor], step), frame)], lifetime)

    def take_answers(self) -> list[tuple[int, Reply]]:
        """Motor and answer of every answer that has come since; waits for none."""
        found = []
        while self._answers:
            channel, reply = self._answers.popleft()
            motor = self._index.get((channel, reply.motor_id))
            if motor is not None:
                found.append((motor, reply))
        return found

    def ask(
        self,
        commands: Mapping[int, Sequence[Command]],
        accept: Callable[[int, Reply], Answer | None],
        patience: Sequence[float] | None = None,
    ) -> dict[int, Answer]:
        """Send each motor's commands and collect one answer per motor.

        Args:
            accept: turns an answer of a motor into the result, or None if it is not the one wanted.
            patience: s to wait for answers, each time that it asks; None: as often as an answer is needed.

        Returns:
            The results by motor; a motor that did not answer any attempt is left out.
        """
        found: dict[int, Answer] = {}
        for wait in _ANSWER_TIMES if patience is None else patience:
            missing = {motor: group for motor, group in commands.items() if motor not in found}
            if not missing:
                break
            self._answers.clear()  # of earlier questions
            self.send(missing)
            deadline = time.monotonic() + wait
            while len(found) < len(commands) and time.monotonic() < deadline:
                time.sleep(_POLL)
                for motor, reply in self.take_answers():
                    if motor in commands and motor not in found and (answer := accept(motor, reply)) is not None:
                        found[motor] = answer
        return found

    def until_status(
        self,
        commands: Mapping[int, Sequence[Command]],
        wanted: Callable[[Status], bool],
        patience: Sequence[float] | None = None,
    ) -> dict[int, Status]:
        """Send each motor's commands until a status that came afterwards is as wanted.

        What counts is the state that a motor reports and not that it answers: a late status to an earlier command, or
        an active report, answers nothing.

        Returns:
            The status by motor; a motor that did not report it after any attempt is left out.
        """
        found: dict[int, Status] = {}
        for wait in _ANSWER_TIMES if patience is None else patience:
            missing = {motor: group for motor, group in commands.items() if motor not in found}
            if not missing:
                break
            before = {motor: self.slots[motor].sample for motor in missing}
            self.send(missing)
            deadline = time.monotonic() + wait
            while len(found) < len(commands) and time.monotonic() < deadline:
                time.sleep(_POLL)
                for motor, old in before.items():
                    sample = self.slots[motor].sample
                    if sample is not None and sample is not old and wanted(sample.status):
                        found[motor] = sample.status
        return found

    def scan(self, motor_ids: Sequence[int], quiet_time: float, pace: float = 0.0) -> list[tuple[int, DeviceId]]:
        """Ask these ids on every channel who is there; every answer with its channel, also second ones of one id.

        Args:
            quiet_time: s without an answer after which nobody else is expected.
            pace: s between two ids; 0: as fast as the bus takes them.
        """
        self._answers.clear()
        some_model = next(iter(MOTORS.values()))  # a question is the same for every model
        for motor_id in motor_ids:
            frame = encode_command(GetDeviceId(motor_id, host_id=self.host_id), some_model)
            for each in self.channels:
                each.send([(None, frame)])
            if pace:
                time.sleep(pace)
        for each in self.channels:
            each.flush(1.0)
        count, quiet_since = -1, 0.0
        while len(self._answers) != count or time.monotonic() - quiet_since < quiet_time:
            if len(self._answers) != count:
                count, quiet_since = len(self._answers), time.monotonic()
            time.sleep(_POLL)
        found: list[tuple[int, DeviceId]] = []
        while self._answers:
            channel, reply = self._answers.popleft()
            if isinstance(reply, DeviceId):
                found.append((channel, reply))
        return found

    # --- parameters

    def read(
        self, parameters: Mapping[int, Parameter], patience: Sequence[float] | None = None
    ) -> dict[int, float | Unreadable]:
        """Return a parameter of each motor."""
        return self._exchange(parameters, {}, patience)

    def write(self, parameter: Parameter, values: Mapping[int, float]) -> dict[int, float | Unreadable]:
        """Write a value to each motor and read it back; what differs is written again: its frame was lost."""
        found: dict[int, float | Unreadable] = {}
        differing = dict.fromkeys(values, parameter)
        for _ in range(_WRITES):
            found |= self._exchange(differing, values)
            differing = {
                i: parameter
                for i, value in found.items()
                if not isinstance(value, Unreadable) and not parameter.is_same(value, values[i])
            }
        return found

    def poll_values(self, parameter: Parameter, motors: Iterable[int], wait: float) -> dict[int, float]:
        """Read once what is read again and again: the latest answers that have come within `wait` s.

        Unlike `read` it takes late answers to earlier questions as well: where a bus, or a program that emulates one,
        takes longer than `wait`, there is an old answer each time, and not none for ever.
        """
        parameters = dict.fromkeys(motors, parameter)
        accept = _values_of(parameters)
        self.send(self._questions(parameters, {}))
        found: dict[int, float | Unreadable] = {}
        deadline = time.monotonic() + wait
        while True:
            for motor, reply in self.take_answers():
                answer = accept(motor, reply) if motor in parameters else None
                if answer is not None:
                    found[motor] = answer
            if len(found) == len(parameters) or time.monotonic() > deadline:
                return {motor: value for motor, value in found.items() if not isinstance(value, Unreadable)}
            time.sleep(_POLL)

    def _exchange(
        self, parameters: Mapping[int, Parameter], values: Mapping[int, float], patience: Sequence[float] | None = None
    ) -> dict[int, float | Unreadable]:
        answers: dict[int, float | Unreadable]
        answers = self.ask(self._questions(parameters, values), _values_of(parameters), patience)
        return {motor: answers.get(motor, Unreadable("no answer", is_silent=True)) for motor in parameters}

    def _questions(
        self, parameters: Mapping[int, Parameter], values: Mapping[int, float]
    ) -> dict[int, Sequence[Command]]:
        questions: dict[int, Sequence[Command]] = {}
        for motor, parameter in parameters.items():
            motor_id = self.motors.motor_id[motor]
            read = ReadParameter(motor_id, parameter.index, host_id=self.host_id)
            if motor in values:
                payload = pack_value(parameter.type, values[motor])
                questions[motor] = [WriteParameter(motor_id, parameter.index, payload, host_id=self.host_id), read]
            else:
                questions[motor] = [read]
        return questions


def _take_status(slot: MotorSlot, sample: Sample) -> None:
    status = sample.status
    if status.faults or status.mode is not MotorMode.RUN:
        slot.alarm = sample
    slot.sample = sample
    if status.is_report:
        slot.reports += 1
    else:
        slot.answers += 1


def _row(sample: Sample) -> tuple[float, ...]:
    status = sample.status
    return sample.time, status.position, status.velocity, status.effort, status.temperature


def _values_of(parameters: Mapping[int, Parameter]) -> Callable[[int, Reply], float | Unreadable | None]:
    """Return what accepts the answers to questions for these parameters."""

    def value(motor: int, reply: Reply) -> float | Unreadable | None:
        if not isinstance(reply, ParameterReply) or reply.index != parameters[motor].index:
            return None
        return float(unpack_value(parameters[motor].type, reply.payload)) if reply.is_success else Unreadable("refused")

    return value
