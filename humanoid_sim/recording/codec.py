"""One tick as one ROS 2 message (`humanoid_sim_msgs/msg/Tick`), the whole `TickRecord`, bit for bit; and events."""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import Any

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
from humanoid_sim.ros2.cdr import ENCAPSULATION, CdrError, decode, encode, encode_fields
from humanoid_sim.ros2.definitions import EVENT, TICK

INTENT_CODES = {intent: code for code, intent in enumerate(Intent)}  # `INTENT_…` of the message definition
_INTENTS = tuple(Intent)
_HEAD = struct.Struct("<Q12d3?BI")  # up to the first array's count, which ends on a multiple of 8
_COUNT = struct.Struct("<I4x")  # count of the other arrays of joints: they begin and end on such multiples
_NO_POLICY = bytes([1, 0, 0, 0, 0])  # an empty string


def encode_tick(record: TickRecord) -> bytes:
    """Return the message of one tick. On the control thread: 10 µs, half of what `encode` alone would take."""
    given, output = record.input, record.output
    state, command = given.state, output.command
    step, standby, remote = output.policy_step, output.standby, given.remote
    steps, standbys, remotes = [], [], []
    if step is not None:
        steps.append(((step.frame,), step.observation, step.action.ravel(), step.action.shape))
    if standby is not None:
        numbers = standby.progress, standby.current_segment, standby.total_segments, standby.is_finished
        standbys.append((numbers,))
    if remote is not None:
        fields = (getattr(remote.command, name) for name in COMMAND_FIELDS)
        remotes.append(((remote.arrival_time,), *fields))
    externs = [(name, (e.arrival_time, e.timeout), e.value.shape, e.value.ravel()) for name, e in state.extern.items()]
    head = _HEAD.pack(
        *(record.index, state.time, record.duration),
        *state.imu_quaternion.tolist(),
        *state.imu_angular_velocity.tolist(),
        *state.imu_linear_acceleration.tolist(),
        *(record.overrun, output.quit, record.qpos is not None, output.control_mode.mode),
        state.joint_count,
    )
    measured = state.joint_position, state.joint_velocity, state.joint_effort, state.joint_age
    commanded = command.position, command.velocity, command.effort, command.stiffness, command.damping
    arrays = _COUNT.pack(state.joint_count).join([array.tobytes() for array in measured + commanded])
    rare = encode_fields(TICK, 10, () if record.qpos is None else record.qpos, steps, standbys, remotes, externs)
    words = output.control_mode, given.safety, given.intents, output.faults, output.refusals
    return b"".join((ENCAPSULATION, head, arrays, rare, _encode_words(*words, output.policy_error, given.policy)))


@lru_cache(maxsize=64)  # they rarely change
def _encode_words(
    control_mode: ControlMode,
    safety: tuple[SafetyStatus, ...],
    intents: tuple[Intent, ...],
    faults: tuple[FaultReport, ...],
    refusals: tuple[str, ...],
    error: str | None,
    policy: str,
) -> bytes:
    return encode_fields(
        TICK,
        15,
        control_mode.controller_name,
        control_mode.status_message,
        [((status.flags, status.level), status.source, status.message) for status in safety],
        [INTENT_CODES[intent] for intent in intents],
        [(fault.controller, fault.fallback, fault.message, (fault.is_bug,)) for fault in faults],
        refusals,
        () if error is None else (error,),
        policy,
    )


def decode_tick(message: bytes) -> TickRecord:
    """Decode the tick of one message. Raises `CdrError` if the bytes are not one."""
    try:
        values = decode(TICK, message)
    except CdrError:  # older recordings end before the last field
        values = decode(TICK, message + bytes(-len(message) % 4) + _NO_POLICY)
    try:
        return _tick(values)
    except (ValueError, IndexError) as error:  # an unknown mode, level or intent, arrays that do not fit each other
        raise CdrError(str(error)) from None


def _tick(values: list[Any]) -> TickRecord:
    index, time, duration, *imu, overrun, has_quit, has_qpos, mode = values[0]
    position, velocity, effort, age = values[1:5]
    command, qpos = MITCommand(*values[5:10]), values[10]
    steps, standbys, remotes, externs = values[11:15]
    controller, message, safety, intents, faults, refusals, errors, policy = values[15:]
    step = standby = remote = None
    for (frame,), observation, action, shape in steps:
        step = PolicyStep(frame, observation, action.reshape(shape))
    for ((progress, segment, total, is_finished),) in standbys:
        standby = StandbyState(segment, total, progress, is_finished)
    for (arrival_time,), *fields in remotes:
        remote = RemoteCommand(MITCommand(*fields), arrival_time)
    live = {name: Extern(value.reshape(shape), *times) for name, times, shape, value in externs}
    state = MITState(time, position, velocity, effort, age, imu[:4], imu[4:7], imu[7:], live)
    if command.position.shape != state.joint_position.shape or not state.joint_count:
        raise CdrError(f"a state of {state.joint_count} joints and a command of {command.joint_count}")
    statuses = [
        SafetyStatus(SafetyLevel(level), SafetyFlag(flags), source, text) for (flags, level), source, text in safety
    ]
    reports = [FaultReport(failed, fallback, reason, is_bug) for failed, fallback, reason, (is_bug,) in faults]
    given = TickInput(state, tuple(statuses), tuple(_INTENTS[code] for code in intents), remote, policy)
    control_mode = ControlMode(Mode(mode), controller, message)
    error = errors[0] if errors else None
    output = TickOutput(command, control_mode, standby, has_quit, tuple(reports), tuple(refusals), step, error)
    return TickRecord(index, given, output, duration, overrun, qpos if has_qpos else None)


def encode_event(event: Event) -> bytes:
    """Return the `humanoid_sim_msgs/msg/Event` of one event."""
    return encode(EVENT, (event.time,), event.text, (event.kind,))


def decode_event(message: bytes) -> Event:
    """Decode the event of one message. Raises `CdrError` if the bytes are not one."""
    (time,), text, (kind,) = decode(EVENT, message)
    try:
        return Event(time, text, EventKind(kind))
    except ValueError as error:
        raise CdrError(str(error)) from None
