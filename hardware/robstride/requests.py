"""Questions to many motors at once, and their answers: one outstanding question per motor, asked again if need be.

Every question of the adapter and of the bench tools goes through here, parameters included.
"""

from __future__ import annotations

import math
import queue
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.bus.open_channels import OpenChannels
from humanoid_sim.hardware.motors import MotorGroup
from humanoid_sim.hardware.robstride.codec import encode_command
from humanoid_sim.hardware.robstride.messages import (
    Command,
    DeviceId,
    Enable,
    GetDeviceId,
    OperationControl,
    ParameterReply,
    ReadParameter,
    Reply,
    Status,
    WriteParameter,
)
from humanoid_sim.hardware.robstride.motor_table import MotorTable
from humanoid_sim.hardware.robstride.parameters import Parameter, pack_value, unpack_value
from humanoid_sim.robots.motors import MOTORS

_ANSWER_TIMES = (0.05, 0.1, 0.2, 0.4)
"""s that a motor has to answer each time that it is asked. It takes milliseconds; the first retries are for a lost
frame, the last for a busy computer."""
_POLL = 0.001
"""s"""

_LIFETIME = 0.06
"""s in which what makes a motor move must leave, or it never does; questions, writes and stops may be late."""
_WRITES = 4
"""Times that a value is written before what is read back counts."""

Answer = TypeVar("Answer")


@dataclass(frozen=True, slots=True)
class Unreadable:
    """A motor answered that it has no such parameter, or did not answer."""

    reason: str
    is_silent: bool = False
    """True if nothing came back."""


_SILENT = Unreadable("no answer", is_silent=True)


class RobstrideLink:
    """Motors on open channels: hears them, and asks them by their index. Give it every frame that is no other family's.

    What asks waits for the answers, while nothing is moving, and never raises.
    """

    def __init__(self, line: OpenChannels, motors: MotorGroup, host_id: int) -> None:
        """Talk to motors."""
        self.line = line
        self.channels, self.sources, self.opened = line.channels, line.sources, line.opened
        self.host_id = host_id
        self.expect(motors)

    def expect(self, motors: MotorGroup) -> None:
        """Talk to these motors from here on; what was heard of others is forgotten."""
        self.motors = motors
        self._by_address = {(motors.channel[i], motors.motor_id[i]): i for i in range(motors.count)}
        self._answers: queue.SimpleQueue[tuple[int, Reply]] = queue.SimpleQueue()
        answers = self._answers
        self.line.forget_notes()
        self.table = MotorTable(motors, self.host_id, self.line.notes)
        self.table.inbox = lambda channel, reply, _: answers.put((channel, reply))

    def receive(self, channel: int, frame: Frame, time: float) -> bool:
        """Take a frame, whatever it is; True."""
        self.table.receive(channel, frame, time)
        return True

    def send(self, commands: Mapping[int, Sequence[Command]]) -> None:
        """Send commands to motors, those of one motor in order; motors take turns.

        Where an earlier round is still waiting to leave, this one takes its place.
        """
        longest = max((len(group) for group in commands.values()), default=0)
        for step in range(longest):
            for joint, group in commands.items():
                if step < len(group):
                    command = group[step]
                    frame = encode_command(command, self.motors.model[joint])
                    lifetime = _LIFETIME if isinstance(command, (Enable, OperationControl)) else math.inf
                    channel = self.channels[self.motors.channel[joint]]
                    channel.send([((type(command), joint, step), frame)], lifetime)

    def ask(
        self,
        commands: Mapping[int, Sequence[Command]],
        accept: Callable[[int, Reply], Answer | None],
        patience: Sequence[float] | None = None,
    ) -> dict[int, Answer]:
        """Send each motor's commands and collect one answer per motor.

        Args:
            accept: turns an answer from a joint's motor into the result, or None if it is not the one wanted.
            patience: s to wait for answers, each time that it asks; None: as often as an answer is needed.

        Returns:
            The results by joint; a motor that did not answer any attempt is left out.
        """
        found: dict[int, Answer] = {}
        for wait in _ANSWER_TIMES if patience is None else patience:
            missing = {joint: group for joint, group in commands.items() if joint not in found}
            if not missing:
                break
            self._drain()
            self.send(missing)
            deadline = time.monotonic() + wait
            while len(found) < len(commands) and (left := deadline - time.monotonic()) > 0.0:
                try:
                    channel, reply = self._answers.get(timeout=left)
                except queue.Empty:
                    break
                joint = self._by_address.get((channel, reply.motor_id))
                if joint is None or joint not in commands or joint in found:
                    continue
                answer = accept(joint, reply)
                if answer is not None:
                    found[joint] = answer
        return found

    def until_status(
        self,
        commands: Mapping[int, Sequence[Command]],
        wanted: Callable[[Status], bool],
        patience: Sequence[float] = _ANSWER_TIMES,
    ) -> dict[int, Status]:
        """Send each motor's commands until a status that came afterwards is as wanted.

        What counts is the state that a motor reports and not that it answers: a late status to an earlier command, or
        an active report, answers nothing.

        Returns:
            The status by joint; a motor that did not report it after any attempt is left out.
        """
        found: dict[int, Status] = {}
        for wait in patience:
            missing = {joint: group for joint, group in commands.items() if joint not in found}
            if not missing:
                break
            before = {joint: self.table.slots[joint].sample for joint in missing}
            self.send(missing)
            deadline = time.monotonic() + wait
            while len(found) < len(commands) and time.monotonic() < deadline:
                time.sleep(_POLL)
                for joint, old in before.items():
                    sample = self.table.slots[joint].sample
                    if sample is not None and sample is not old and wanted(sample.status):
                        found[joint] = sample.status
        return found

    def take_answers(self) -> list[tuple[int, Reply]]:
        """Index and answer of every answer that has come since; waits for none."""
        found = []
        while not self._answers.empty():
            channel, reply = self._answers.get_nowait()
            joint = self._by_address.get((channel, reply.motor_id))
            if joint is not None:
                found.append((joint, reply))
        return found

    def scan(self, motor_ids: Sequence[int], quiet_time: float, pace: float = 0.0) -> list[tuple[int, DeviceId]]:
        """Ask these ids on every channel who is there; every answer with its channel, also second ones of one id.

        Args:
            quiet_time: s without an answer after which nobody else is expected.
            pace: s between two ids; 0: as fast as the bus takes them.
        """
        self._drain()
        some_model = next(iter(MOTORS.values()))  # a question looks the same for every model
        found: list[tuple[int, DeviceId]] = []
        for motor_id in motor_ids:
            frame = encode_command(GetDeviceId(motor_id, host_id=self.host_id), some_model)
            for channel in self.channels:
                channel.send([(None, frame)])
            if pace:
                time.sleep(pace)
        for channel in self.channels:
            channel.flush(1.0)
        while True:
            try:
                channel_index, reply = self._answers.get(timeout=quiet_time)
            except queue.Empty:
                return found
            if isinstance(reply, DeviceId):
                found.append((channel_index, reply))

    def _drain(self) -> None:
        """Forget answers that came too late to their questions."""
        while not self._answers.empty():
            self._answers.get_nowait()

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

    def poll_values(self, parameter: Parameter, joints: Iterable[int], wait: float) -> dict[int, float]:
        """Read once what is read again and again: the latest answers that have come within `wait` s.

        Unlike `read` it takes late answers to earlier questions as well: where a bus, or whoever emulates one, takes
        longer than `wait`, there is an old answer each time, and not none for ever. Motors that have none are left out.
        """
        parameters = dict.fromkeys(joints, parameter)
        accept = _values_of(parameters)
        self.send(self._questions(parameters, {}))
        found: dict[int, float | Unreadable] = {}
        deadline = time.monotonic() + wait
        while True:
            for joint, reply in self.take_answers():
                answer = accept(joint, reply) if joint in parameters else None
                if answer is not None:
                    found[joint] = answer
            if len(found) == len(parameters) or time.monotonic() > deadline:
                return {joint: value for joint, value in found.items() if not isinstance(value, Unreadable)}
            time.sleep(_POLL)

    def _exchange(
        self, parameters: Mapping[int, Parameter], values: Mapping[int, float], patience: Sequence[float] | None = None
    ) -> dict[int, float | Unreadable]:
        questions = self._questions(parameters, values)
        answers: dict[int, float | Unreadable] = self.ask(questions, _values_of(parameters), patience)
        return {joint: answers.get(joint, _SILENT) for joint in parameters}

    def _questions(
        self, parameters: Mapping[int, Parameter], values: Mapping[int, float]
    ) -> dict[int, Sequence[Command]]:
        questions: dict[int, Sequence[Command]] = {}
        for joint, parameter in parameters.items():
            motor_id = self.motors.motor_id[joint]
            read = ReadParameter(motor_id, parameter.index, host_id=self.host_id)
            if joint in values:
                payload = pack_value(parameter.type, values[joint])
                questions[joint] = [WriteParameter(motor_id, parameter.index, payload, host_id=self.host_id), read]
            else:
                questions[joint] = [read]
        return questions

    @property
    def unanswered(self) -> int:
        """Commands that no status has answered yet; those that never left are left out."""
        unsent = sum(channel.counters.superseded + channel.counters.stale for channel in self.channels)
        return sum(slot.commanded - slot.acknowledged for slot in self.table.slots) - unsent


def _values_of(parameters: Mapping[int, Parameter]) -> Callable[[int, Reply], float | Unreadable | None]:
    """Return what accepts the answers to questions for these parameters."""

    def value(joint: int, reply: Reply) -> float | Unreadable | None:
        if not isinstance(reply, ParameterReply) or reply.index != parameters[joint].index:
            return None
        return float(unpack_value(parameters[joint].type, reply.payload)) if reply.is_success else Unreadable("refused")

    return value
