"""One tick as one ROS 2 message (`humanoid_sim_msgs/msg/Tick`), the whole `TickRecord`, bit for bit; and events.

Every tick of a run goes through here, so the encoder does little: the numbers leave their arrays as bytes, the parts
that are nearly always empty cost one constant, and the texts are encoded again only when they change.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from humanoid_sim.messages import (
    ControlMode,
    Event,
    EventKind,
    FaultReport,
    Intent,
    Mode,
    PolicyStep,
    RemoteCommand,
    SafetyFlag,
    SafetyLevel,
    SafetyStatus,
    StandbyState,
    TickInput,
    TickOutput,
    TickRecord,
)
from humanoid_sim.mit import COMMAND_FIELDS, Extern, MITCommand, MITState
from humanoid_sim.ros2.cdr import ENCAPSULATION, CdrError, CdrReader, CdrWriter, layout

_Part = TypeVar("_Part")

INTENT_CODES = {intent: code for code, intent in enumerate(Intent)}  # `INTENT_…` of the message definition
_INTENTS = tuple(Intent)

_FLAG_CODES = "???B"
_HEAD, _FLAGS = layout("Qdd"), layout(_FLAG_CODES)
# The head is 8·(3 + 4 + 3 + 3) + 4 bytes long: the first array's count ends on a multiple of 8. Later ones stand on
# one, because float64 arrays end there, and are padded to the next.
_FIRST_COUNT, _COUNT = struct.Struct("<I"), struct.Struct("<I4x")
_NO_STEP_STANDBY_REMOTE_EXTERN = bytes(16)
_NO_QPOS = bytes(4)


class TickEncoder:
    """Encodes the ticks of one robot. Keeps the last tick's texts, so use one per recording, from one thread."""

    def __init__(self, joint_count: int) -> None:
        self._first_count, self._count = _FIRST_COUNT.pack(joint_count), _COUNT.pack(joint_count)
        self._texts: tuple[Any, ...] = ()
        self._encoded_texts = b""

    def encode(self, record: TickRecord) -> bytes:
        """Return the message of one tick."""
        state, command = record.input.state, record.output.command
        parts = [
            ENCAPSULATION,
            _HEAD.pack(record.index, state.time, record.duration),
            state.imu_quaternion.tobytes(),
            state.imu_angular_velocity.tobytes(),
            state.imu_linear_acceleration.tobytes(),
            _FLAGS.pack(record.overrun, record.output.quit, record.qpos is not None, record.output.control_mode.mode),
            self._first_count,
            state.joint_position.tobytes(),
        ]
        measured = state.joint_velocity, state.joint_effort, state.joint_age
        commanded = command.position, command.velocity, command.effort, command.stiffness, command.damping
        for array in (*measured, *commanded):
            parts += (self._count, array.tobytes())
        return b"".join((*parts, *_encode_rest(record), self._encode_texts(record.input, record.output)))

    def _encode_texts(self, tick_input: TickInput, output: TickOutput) -> bytes:
        """Return what rarely changes. No field of it is wider than 4 bytes, so its bytes fit at any multiple of 4."""
        control, error = output.control_mode, output.policy_error
        texts = control, tick_input.safety, tick_input.intents, output.faults, output.refusals, error, tick_input.policy
        if texts == self._texts:
            return self._encoded_texts
        writer = CdrWriter()
        writer.string(control.controller_name)
        writer.string(control.status_message)
        writer.pack("I", len(tick_input.safety))
        for status in tick_input.safety:
            writer.pack("IB", status.flags, status.level)
            writer.string(status.source)
            writer.string(status.message)
        writer.array(np.array([INTENT_CODES[intent] for intent in tick_input.intents], dtype=np.uint8))
        writer.pack("I", len(output.faults))
        for fault in output.faults:
            writer.string(fault.controller)
            writer.string(fault.fallback)
            writer.string(fault.message)
            writer.pack("?", fault.is_bug)
        writer.strings(output.refusals)
        writer.strings(() if error is None else (error,))
        writer.string(tick_input.policy)
        self._texts, self._encoded_texts = texts, writer.body()
        return self._encoded_texts


def _encode_rest(record: TickRecord) -> tuple[bytes, bytes, bytes]:
    """`qpos`, and the numeric parts that most ticks lack; begins on a multiple of 8, ends on a multiple of 4."""
    qpos, state, output = record.qpos, record.input.state, record.output
    head, data, skip = _NO_QPOS, b"", 4
    if qpos is not None and len(qpos):
        head, data, skip = _COUNT.pack(len(qpos)), np.asarray(qpos, dtype=np.float64).tobytes(), 0
    step, standby, remote, extern = output.policy_step, output.standby, record.input.remote, state.extern
    if step is None and standby is None and remote is None and not extern:
        return head, data, _NO_STEP_STANDBY_REMOTE_EXTERN
    writer = CdrWriter(skip)
    writer.pack("I", step is not None)
    if step is not None:
        writer.pack("q", step.frame)
        writer.array(step.observation)
        writer.array(step.action)
        writer.array(np.array(step.action.shape, dtype=np.uint32))
    writer.pack("I", standby is not None)
    if standby is not None:
        writer.pack("dII?", standby.progress, standby.current_segment, standby.total_segments, standby.is_finished)
    writer.pack("I", remote is not None)
    if remote is not None:
        writer.pack("d", remote.arrival_time)
        for name in COMMAND_FIELDS:
            writer.array(getattr(remote.command, name))
    writer.pack("I", len(extern))
    for name, live in extern.items():
        writer.string(name)
        writer.pack("dd", live.arrival_time, live.timeout)
        writer.array(np.array(live.value.shape, dtype=np.uint32))
        writer.array(live.value)
    return head, data, writer.body()


def decode_tick(message: bytes) -> TickRecord:
    """Decode the tick of one message. Raises `CdrError` if the bytes are not one."""
    try:
        return _decode(CdrReader(message))
    except (ValueError, IndexError) as error:  # an unknown mode, level or intent, arrays that do not fit each other
        raise CdrError(str(error)) from None


def _decode(reader: CdrReader) -> TickRecord:
    index, time, duration = reader.unpack("Qdd")
    quaternion, angular_velocity, linear_acceleration = (reader.fixed_array(np.float64, width) for width in (4, 3, 3))
    overrun, has_quit, has_qpos, mode = reader.unpack(_FLAG_CODES)
    position, velocity, effort, age = (reader.array(np.float64) for _ in range(4))
    command = _decode_command(reader)
    if command.position.shape != position.shape or not len(position):
        raise CdrError(f"a state of {len(position)} joints and a command of {command.joint_count}")
    qpos = reader.array(np.float64)
    step = _optional(reader, _decode_step)
    standby = _optional(reader, _decode_standby)
    remote = _optional(reader, _decode_remote)
    extern = dict(_decode_extern(reader) for _ in range(reader.count(21)))
    state = MITState(time, position, velocity, effort, age, quaternion, angular_velocity, linear_acceleration, extern)
    control_mode = ControlMode(Mode(mode), reader.string(), reader.string())
    safety = tuple(_decode_safety(reader) for _ in range(reader.count(15)))
    intents = tuple(_INTENTS[code] for code in reader.array(np.uint8))
    faults = tuple(
        FaultReport(reader.string(), reader.string(), reader.string(), *reader.unpack("?"))
        for _ in range(reader.count(16))
    )
    refusals = reader.strings()
    policy_error = _optional(reader, CdrReader.string)
    policy = reader.string() if reader.remaining > 3 else ""  # older recordings have none
    reader.finish()
    tick_input = TickInput(state, safety, intents, remote, policy)
    output = TickOutput(command, control_mode, standby, has_quit, faults, refusals, step, policy_error)
    return TickRecord(index, tick_input, output, duration, overrun, qpos if has_qpos else None)


def _optional(reader: CdrReader, decode: Callable[[CdrReader], _Part]) -> _Part | None:
    """Return a sequence that holds nothing (None) or one thing."""
    count = reader.count()
    if count > 1:
        raise CdrError(f"{count} elements where there is at most one")
    return decode(reader) if count else None


def _decode_step(reader: CdrReader) -> PolicyStep:
    (frame,) = reader.unpack("q")
    observation, action = reader.array(np.float32), reader.array(np.float32)
    return PolicyStep(frame, observation, _reshaped(action, reader.array(np.uint32)))


def _decode_standby(reader: CdrReader) -> StandbyState:
    progress, current, total, is_finished = reader.unpack("dII?")
    return StandbyState(current, total, progress, is_finished)


def _decode_remote(reader: CdrReader) -> RemoteCommand:
    (arrival_time,) = reader.unpack("d")
    return RemoteCommand(_decode_command(reader), arrival_time)


def _decode_command(reader: CdrReader) -> MITCommand:
    return MITCommand(*(reader.array(np.float64) for _ in COMMAND_FIELDS))


def _decode_extern(reader: CdrReader) -> tuple[str, Extern]:
    name = reader.string()
    arrival_time, timeout = reader.unpack("dd")
    shape = reader.array(np.uint32)
    return name, Extern(_reshaped(reader.array(np.float64), shape), arrival_time, timeout)


def _decode_safety(reader: CdrReader) -> SafetyStatus:
    flags, level = reader.unpack("IB")
    return SafetyStatus(SafetyLevel(level), SafetyFlag(flags), reader.string(), reader.string())


def _reshaped(values: npt.NDArray[Any], shape: npt.NDArray[np.uint32]) -> npt.NDArray[Any]:
    return values.reshape(tuple(int(size) for size in shape))


def encode_event(event: Event) -> bytes:
    """Return the `humanoid_sim_msgs/msg/Event` of one event."""
    writer = CdrWriter()
    writer.pack("d", event.time)
    writer.string(event.text)
    writer.pack("B", event.kind)
    return writer.message()


def decode_event(message: bytes) -> Event:
    """Decode the event of one message. Raises `CdrError` if the bytes are not one."""
    reader = CdrReader(message)
    (time,), text, (code,) = reader.unpack("d"), reader.string(), reader.unpack("B")
    try:
        return Event(time, text, EventKind(code))
    except ValueError as error:
        raise CdrError(str(error)) from None
