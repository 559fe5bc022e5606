"""Robstride motors on open channels: the latest of each, and questions to many at once with their answers.

Receiver threads write, the control thread reads, and neither waits for the other: each slot is written by the one
receiver thread of its channel, only ever by assigning whole objects.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import numpy as np

from humanoid_sim.hardware.can_bus import NEVER, Frame, Note, OpenChannels
from humanoid_sim.hardware.motor_link import Motor, Readings
from humanoid_sim.hardware.robstride import protocol
from humanoid_sim.hardware.robstride.firmware import FirmwareVersion
from humanoid_sim.hardware.robstride.parameters import Parameter, pack_value, unpack_value
from humanoid_sim.hardware.robstride.protocol import DEFAULT_HOST_ID, DeviceId, FrameType, MotorMode, Status
from humanoid_sim.robots.motors import MotorModel

_COMMANDS = frozenset(FrameType) - {FrameType.GET_DEVICE_ID, FrameType.READ_PARAMETER}  # others may only scan and read

_HOSTS = {DEFAULT_HOST_ID: f"this host's id {DEFAULT_HOST_ID} (an echo, as in loopback mode?)"}
_IGNORED = {  # by the reason for which a frame is ignored
    "standard_id": "frame with an 11-bit identifier",
    "host_command": "command of {}",
    "other_host": "answer to another host",
    "unknown_device": "frame of no motor of this robot",
}


class Sample(NamedTuple):
    """A status and when it came."""

    time: float  # s, robot's clock
    status: Status


@dataclass(slots=True)
class MotorSlot:
    """The latest of everything that came from one motor. Written by one receiver thread."""

    sample: Sample | None = None
    report: protocol.FaultReport | None = None
    invalid: Note = NEVER  # the latest frame that could not be read
    uid: bytes | None = None
    version: FirmwareVersion | None = None
    parameters: dict[int, protocol.ParameterReply] = field(default_factory=dict)  # by index, until somebody takes them

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
        return ", ".join([f"mode {status.mode.name.lower()}", *protocol.flag_names(status.faults)])


_ANSWER_TIMES = (0.05, 0.1, 0.2, 0.4)  # s that a motor has to answer each request: a lost frame, a busy computer
_POLL = 0.001  # s
_LIFETIME = 0.06  # s in which what makes a motor move must leave, or it never does; other frames may be late
_WRITES = 4  # times that a value is written before what is read back counts
_MOST_IDS = 4096  # answers to a scan
Answer = TypeVar("Answer")


class RobstrideLink:
    """Motors on open channels, each known by its index. Its `receive` must be given every frame of no other family.

    What asks waits for the answers, while nothing is moving, and never raises; motors that do not answer are left out.
    """

    def __init__(self, line: OpenChannels, motors: Sequence[Motor]) -> None:
        self.line, self.sources, self.motors = line, line.sources, motors
        self.slots = tuple(MotorSlot() for _ in motors)
        self._device_ids: deque[tuple[int, DeviceId]] = deque(maxlen=_MOST_IDS)  # with their channel
        self._index = {(motor.channel, motor.motor_id): i for i, motor in enumerate(motors)}
        self._models: list[dict[int, MotorModel]] = [{} for _ in line.channels]
        for motor in motors:
            self._models[motor.channel][motor.motor_id] = motor.model

    # --- receiver threads

    def receive(self, channel: int, frame: Frame, time: float) -> bool:
        """Take a frame, whatever it is; True."""
        bus = self.line.channels[channel]
        kind, _, sender, destination = protocol.split_identifier(frame.arbitration_id)
        # A fault is a fault, whomever the motor reports it to: the manuals do not say where unasked reports go.
        host_id = destination if kind == FrameType.FAULT_REPORT else DEFAULT_HOST_ID
        reply = protocol.decode_reply(frame, self._models[channel], host_id)
        index = self._index.get((channel, sender))
        slot = None if index is None else self.slots[index]
        match reply:
            case protocol.Ignored("host_command") if kind in _COMMANDS and (channel, destination) in self._index:
                host = "another host" if kind == FrameType.OPERATION_CONTROL else _HOSTS.get(sender, "another host")
                bus.intruder = Note(time, f"{host} sends '{protocol.type_name(kind)}' to motor {destination}")
            case protocol.Ignored("other_host") if slot is not None and kind == FrameType.STATUS:
                # Another host commands it, or its own id is stored in it: commands do not name their host.
                bus.intruder = Note(time, f"motor {sender} answers host {destination}, not {DEFAULT_HOST_ID}")
            case protocol.Ignored("unknown_type" | "host_command") if slot is not None and destination in (
                DEFAULT_HOST_ID,
                protocol.BROADCAST_ID,
            ):
                slot.invalid = Note(time, f"frame of communication type {kind}")
            case protocol.Ignored(reason):
                host = _HOSTS.get(sender, "another host")
                bus.strangers[_IGNORED.get(reason, reason.replace("_", " ")).format(host)] += 1
            case protocol.Malformed() if slot is not None:
                slot.invalid = Note(time, reply.reason)
            case DeviceId():
                self._device_ids.append((channel, reply))
                if slot is not None:
                    slot.uid = reply.uid
            case Status() if slot is not None:
                slot.sample = Sample(time, reply)
            case protocol.FaultReport() if slot is not None:
                slot.report = reply
            case protocol.ParameterReply() if slot is not None:
                slot.parameters[reply.index] = reply
            case protocol.Version() if slot is not None:
                slot.version = reply.version
        return True

    # --- control thread

    def readings(self) -> Readings:
        rows = np.full((len(self.slots), len(Readings._fields)), np.nan)
        for row, slot in zip(rows, self.slots, strict=True):
            if slot.sample is not None:
                time, status = slot.sample
                row[:] = time, status.position, status.velocity, status.effort, status.temperature
        return Readings(*rows.T)

    # --- questions

    def frame(self, motor: int, kind: FrameType, data: bytes = b"") -> Frame:
        return protocol.encode_command(kind, self.motors[motor].motor_id, data)

    def send(self, frames: Mapping[int, Sequence[Frame]]) -> None:
        """Send frames to motors, one motor after the other, in the place of an earlier round that still waits."""
        for motor, group in frames.items():
            channel = self.line.channels[self.motors[motor].channel]
            for step, frame in enumerate(group):
                moves = frame.arbitration_id >> 24 in (FrameType.ENABLE, FrameType.OPERATION_CONTROL)
                key = (frame.arbitration_id if moves else frame, step)
                channel.send([(key, frame)], _LIFETIME if moves else math.inf)

    def _ask(
        self,
        frames: Mapping[int, Sequence[Frame]],
        take: Callable[[], Mapping[int, Answer]],  # returns the answers that have come
        patience: Sequence[float] = (),  # s to wait for answers, each time that it asks; empty: the usual
    ) -> dict[int, Answer]:
        """Send each motor's frames, again while its answer is missing, and return the answers."""
        found: dict[int, Answer] = {}
        for wait in patience or _ANSWER_TIMES:
            missing = [motor for motor in frames if motor not in found]
            self.send({motor: frames[motor] for motor in missing})
            deadline = time.monotonic() + wait
            while len(found) < len(frames):
                found |= {motor: one for motor, one in take().items() if motor in frames}
                if time.monotonic() >= deadline:
                    break
                time.sleep(_POLL)
        return found

    def until_status(
        self, frames: Mapping[int, Sequence[Frame]], wanted: Callable[[Status], bool]
    ) -> dict[int, Status]:
        """Send each motor's frames until a status that came afterwards is as wanted."""
        before = [slot.sample for slot in self.slots]

        def take() -> dict[int, Status]:
            samples = [slot.sample for slot in self.slots]
            new = [(i, one.status) for i, one in enumerate(samples) if one is not None and one is not before[i]]
            return {i: status for i, status in new if wanted(status)}

        return self._ask(frames, take)

    def stop_motors(self, motors: Iterable[int], *, clear_faults: bool = False) -> tuple[int, ...]:
        """Stop motors, and clear their faults on request; returns those that did not confirm it."""
        frames = {i: [self.frame(i, FrameType.STOP, protocol.CLEAR_FAULTS if clear_faults else b"")] for i in motors}
        confirmed = self.until_status(
            frames, lambda status: status.mode is MotorMode.RESET and not (clear_faults and status.faults)
        )
        return tuple(i for i in frames if i not in confirmed)

    def read_versions(self, motors: Iterable[int]) -> dict[int, FirmwareVersion]:
        """Return motors' firmware; one that does not know the question takes it for a stop, and is left out."""
        frames = {i: [self.frame(i, FrameType.STOP, protocol.READ_VERSION)] for i in motors}
        for slot in self.slots:
            slot.version = None
        return self._ask(frames, lambda: {i: one.version for i, one in enumerate(self.slots) if one.version})

    def read_uids(self, motors: Iterable[int]) -> dict[int, bytes]:
        frames = {i: [self.frame(i, FrameType.GET_DEVICE_ID)] for i in motors}
        for slot in self.slots:
            slot.uid = None
        return self._ask(frames, lambda: {i: one.uid for i, one in enumerate(self.slots) if one.uid})

    def scan(self, motor_ids: Sequence[int], quiet_time: float, pace: float = 0.0) -> list[tuple[int, DeviceId]]:
        """Ask these ids on every channel who is there; every answer with its channel, also second ones of one id.

        Nobody else is expected after `quiet_time` s without an answer; `pace`: s between two ids.
        """
        self._device_ids.clear()
        for motor_id in motor_ids:
            for each in self.line.channels:
                each.send([(None, protocol.encode_command(FrameType.GET_DEVICE_ID, motor_id))])
            time.sleep(pace)
        for each in self.line.channels:
            each.flush(1.0)
        count, quiet_since = 0, time.monotonic()
        while time.monotonic() - quiet_since < quiet_time:
            if len(self._device_ids) > count:
                count, quiet_since = len(self._device_ids), time.monotonic()
            time.sleep(_POLL)
        return list(self._device_ids)

    # --- parameters; NaN: a motor does not have it

    def read(
        self,
        parameter: Parameter,
        motors: Iterable[int],
        patience: Sequence[float] = (),
        *,
        takes_late: bool = False,
        before: Mapping[int, Sequence[Frame]] = MappingProxyType({}),  # sent to each motor before it is asked
    ) -> dict[int, float]:
        """Return a parameter of each motor.

        `takes_late`: late answers to earlier questions count, for what is read again and again: where a bus takes
        longer than `patience`, there is an old answer each time, and not none for ever.
        """
        data = protocol.parameter_data(parameter.index)
        frames = {i: [*before.get(i, ()), self.frame(i, FrameType.READ_PARAMETER, data)] for i in motors}
        if not takes_late:
            self.take_values(parameter)
        return self._ask(frames, lambda: self.take_values(parameter), patience)

    def write(self, parameter: Parameter, values: Mapping[int, float]) -> dict[int, float]:
        """Write a value to each motor and read it back; what differs is written again: its frame was lost."""
        found: dict[int, float] = {}
        wrong = list(values)
        for _ in range(_WRITES):
            found |= self.read(parameter, wrong, before={i: [self.write_frame(i, parameter, values[i])] for i in wrong})
            wrong = [i for i, one in found.items() if math.isfinite(one) and not parameter.is_same(one, values[i])]
        return found

    def take_values(self, parameter: Parameter) -> dict[int, float]:
        """Return the values that motors have answered since, each once; waits for none."""
        found = {}
        for i, slot in enumerate(self.slots):
            reply = slot.parameters.pop(parameter.index, None)
            if reply is not None:
                found[i] = unpack_value(parameter.type, reply.payload) if reply.is_success else math.nan
        return found

    def write_frame(self, motor: int, parameter: Parameter, value: float) -> Frame:
        data = protocol.parameter_data(parameter.index, pack_value(parameter.type, value))
        return self.frame(motor, FrameType.WRITE_PARAMETER, data)
