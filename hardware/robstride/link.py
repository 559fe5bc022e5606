"""Robstride motors on open channels: the latest of each, and questions to many at once with their answers.

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
from humanoid_sim.hardware.bus.open_channels import OpenChannels
from humanoid_sim.hardware.motor_link import MotorGroup, Readings
from humanoid_sim.hardware.robstride import messages
from humanoid_sim.hardware.robstride.codec import decode_reply, encode_command
from humanoid_sim.hardware.robstride.messages import (
    DEFAULT_HOST_ID,
    Command,
    FrameType,
    MotorMode,
    Reply,
    split_identifier,
)
from humanoid_sim.hardware.robstride.parameters import Parameter, pack_value, unpack_value
from humanoid_sim.robots.motors import MOTORS

_COMMANDS = frozenset(FrameType) - {FrameType.GET_DEVICE_ID, FrameType.READ_PARAMETER}  # others may only scan and read
_OURS = frozenset({DEFAULT_HOST_ID, messages.BROADCAST_ID})
_STRANGERS = {"standard_id": "frame with an 11-bit identifier"}  # other reasons say enough


class Sample(NamedTuple):
    """A status and when it came, s, robot's clock."""

    time: float
    status: messages.Status


@dataclass(slots=True)
class MotorSlot:
    """Data received from one motor. Written by one receiver thread."""

    sample: Sample | None = None
    alarm: Sample | None = None  # the latest status that reported a fault or a mode other than RUN
    report: messages.FaultReport | None = None
    invalid: Note = NEVER  # the latest frame that could not be read
    statuses: int = 0
    hides_timeout: bool = False  # its CAN timeout cannot be read, and is tried out

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
        return ", ".join([f"mode {status.mode.name.lower()}", *messages.flag_names(status.faults)])


_ANSWER_TIMES = (0.05, 0.1, 0.2, 0.4)  # s that a motor has to answer each request: a lost frame, a busy computer
_POLL = 0.001  # s
_LIFETIME = 0.06  # s in which what makes a motor move must leave, or it never does; other frames may be late
_WRITES = 4  # times that a value is written before what is read back counts
_MOST_ANSWERS = 4096  # that wait for `take_answers`
Answer = TypeVar("Answer")


class RobstrideLink:
    """Motors on open channels, each known by its index. Its `receive` must be given every frame of no other family.

    What asks waits for the answers, while nothing is moving, and never raises.
    """

    def __init__(self, line: OpenChannels, motors: MotorGroup) -> None:
        """Send nothing yet."""
        self.line = line
        self.channels, self.sources = line.channels, line.sources
        self.expect(motors)

    def expect(self, motors: MotorGroup) -> None:
        """Talk to these motors from here on; everything received from others is forgotten."""
        self.motors = motors
        self.slots = tuple(MotorSlot() for _ in range(motors.count))
        self._answers: deque[tuple[int, Reply]] = deque(maxlen=_MOST_ANSWERS)  # with their channel
        self._index = {(motors.channel[i], motors.motor_id[i]): i for i in range(motors.count)}
        self._models = tuple(
            {motors.motor_id[i]: motors.model[i] for i in motors.on_channel(channel)}
            for channel in range(len(self.channels))
        )
        self.line.forget_notes()

    # --- receiver threads

    def receive(self, channel: int, frame: Frame, time: float) -> bool:
        """Take a frame, whatever it is; True."""
        notes, parts = self.line.notes[channel], split_identifier(frame.arbitration_id)
        kind, _, sender, destination = parts
        # A fault is a fault, whomever the motor reports it to: the manuals do not say where unasked reports go.
        host_id = destination if kind == FrameType.FAULT_REPORT else DEFAULT_HOST_ID
        reply = decode_reply(frame, self._models[channel], host_id)
        slot = None if (i := self._index.get((channel, sender))) is None else self.slots[i]
        match reply:
            case messages.Ignored("host_command") if kind in _COMMANDS and (channel, destination) in self._index:
                who = "another host" if kind == FrameType.OPERATION_CONTROL else f"host 0x{sender:02X}"
                name = FrameType(kind).name.lower().replace("_", " ")
                notes.intruder = Note(time, f"{who} sends '{name}' to motor {destination}")
            case messages.Ignored("other_host") if slot is not None and kind == FrameType.STATUS:
                # Another host commands it, or its own id is stored in it: commands do not name their host.
                notes.intruder = Note(time, f"motor {sender} answers host {destination}, not {DEFAULT_HOST_ID}")
            case messages.Ignored("unknown_type" | "host_command") if slot is not None and destination in _OURS:
                slot.invalid = Note(time, f"frame of communication type {kind}")
            case messages.Ignored(reason):
                notes.strangers[_STRANGERS.get(reason, reason.replace("_", " "))] += 1
            case messages.DeviceId() | messages.ParameterReply() | messages.Version():
                self._answers.append((channel, reply))
            case messages.Malformed() if slot is not None:
                slot.invalid = Note(time, reply.reason)
            case messages.FaultReport() if slot is not None:
                slot.report = reply
            case messages.Status() if slot is not None:
                self._answers.append((channel, reply))
                slot.sample = Sample(time, reply)
                slot.statuses += 1
                if reply.faults or reply.mode is not MotorMode.RUN:
                    slot.alarm = slot.sample
        return True

    # --- control thread

    def readings(self) -> Readings:
        """Return the latest status of every motor."""
        rows = [_row(slot.sample) for slot in self.slots]
        return Readings(*np.array(rows).reshape(-1, len(Readings._fields)).T)

    # --- questions

    def send(self, commands: Mapping[int, Sequence[Command]]) -> None:
        """Send commands to motors, those of one motor in order; motors take turns.

        Where an earlier round is still waiting to leave, this one takes its place.
        """
        longest = max((len(group) for group in commands.values()), default=0)
        for step in range(longest):
            for motor, group in commands.items():
                if step < len(group):
                    command, channel = group[step], self.channels[self.motors.channel[motor]]
                    frame = encode_command(command, self.motors.model[motor])
                    moves = isinstance(command, messages.Enable | messages.OperationControl)
                    key = type(command), self.motors.names[motor], step
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
        commands: Mapping[int, Sequence[Command]],
        accept: Callable[[int, Reply], Answer | None],  # None: another answer than the wanted one
        patience: Sequence[float] | None = None,  # s to wait for answers, each time that it asks
        *,
        takes_late: bool = False,  # answers to earlier questions count
    ) -> dict[int, Answer]:
        """Send each motor's commands and collect one answer per motor; those that did not answer are left out."""
        found: dict[int, Answer] = {}
        for wait in _ANSWER_TIMES if patience is None else patience:
            missing = {motor: group for motor, group in commands.items() if motor not in found}
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
                if len(found) == len(commands) or time.monotonic() >= deadline:
                    break
                time.sleep(_POLL)
        return found

    def until_status(
        self, commands: Mapping[int, Sequence[Command]], wanted: Callable[[messages.Status], bool]
    ) -> dict[int, messages.Status]:
        """Send each motor's commands until a status that came afterwards is as wanted; other motors are left out."""

        def accept(_: int, reply: Reply) -> messages.Status | None:
            return reply if isinstance(reply, messages.Status) and wanted(reply) else None

        return self.ask(commands, accept)

    def scan(
        self, motor_ids: Sequence[int], quiet_time: float, pace: float = 0.0
    ) -> list[tuple[int, messages.DeviceId]]:
        """Ask these ids on every channel who is there; every answer with its channel, also second ones of one id.

        Nobody else is expected after `quiet_time` s without an answer; `pace`: s between two ids.
        """
        self._answers.clear()
        some_model = next(iter(MOTORS.values()))  # a question is the same for every model
        for motor_id in motor_ids:
            frame = encode_command(messages.GetDeviceId(motor_id), some_model)
            for each in self.channels:
                each.send([(None, frame)])
            time.sleep(pace)
        for each in self.channels:
            each.flush(1.0)
        found: list[tuple[int, messages.DeviceId]] = []
        quiet_since = time.monotonic()
        while time.monotonic() - quiet_since < quiet_time:
            while self._answers:
                channel, reply = self._answers.popleft()
                if isinstance(reply, messages.DeviceId):
                    found.append((channel, reply))
                    quiet_since = time.monotonic()
            time.sleep(_POLL)
        return found

    # --- parameters: those that a motor does not answer are left out, those that it does not have are None

    def read(
        self, parameters: Mapping[int, Parameter], patience: Sequence[float] | None = None
    ) -> dict[int, float | None]:
        """Return a parameter of each motor."""
        return self._exchange(parameters, {}, patience)

    def write(self, parameter: Parameter, values: Mapping[int, float]) -> dict[int, float | None]:
        """Write a value to each motor and read it back; what differs is written again: its frame was lost."""
        found: dict[int, float | None] = {}
        differing = dict.fromkeys(values, parameter)
        for _ in range(_WRITES):
            found |= self._exchange(differing, values)
            differing = {
                i: parameter
                for i, value in found.items()
                if value is not None and not parameter.is_same(value, values[i])
            }
        return found

    def poll_values(self, parameter: Parameter, motors: Iterable[int], wait: float) -> dict[int, float]:
        """Read once what is read again and again: answers that have come within `wait` s.

        Unlike `read` it takes late answers to earlier questions as well: where a bus, or a program that emulates one,
        takes longer than `wait`, there is an old answer each time, and not none for ever.
        """
        found = self._exchange(dict.fromkeys(motors, parameter), {}, (wait,), takes_late=True)
        return {motor: value for motor, value in found.items() if value is not None}

    def _exchange(
        self,
        parameters: Mapping[int, Parameter],
        values: Mapping[int, float],
        patience: Sequence[float] | None = None,
        *,
        takes_late: bool = False,
    ) -> dict[int, float | None]:
        questions: dict[int, Sequence[Command]] = {}
        for motor, parameter in parameters.items():
            motor_id = self.motors.motor_id[motor]
            question: Command = messages.ReadParameter(motor_id, parameter.index)
            questions[motor] = [question]
            if motor in values:
                payload = pack_value(parameter.type, values[motor])
                write = messages.WriteParameter(motor_id, parameter.index, payload)
                questions[motor] = [write, question]

        def accept(motor: int, reply: Reply) -> tuple[float | None] | None:
            parameter = parameters[motor]
            if not isinstance(reply, messages.ParameterReply) or reply.index != parameter.index:
                return None
            return (float(unpack_value(parameter.type, reply.payload)) if reply.is_success else None,)

        answers = self.ask(questions, accept, patience, takes_late=takes_late)
        return {motor: value for motor, (value,) in answers.items()}


def _row(sample: Sample | None) -> tuple[float, ...]:
    if sample is None:
        return (math.nan,) * len(Readings._fields)
    status = sample.status
    return sample.time, status.position, status.velocity, status.effort, status.temperature
