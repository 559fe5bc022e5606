"""One tick as one ROS 2 message (`humanoid_sim_msgs/msg/Tick`), the whole `TickRecord`, bit for bit; and events."""

from __future__ import annotations

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
from humanoid_sim.ros2.cdr import CdrError, decode, encode
from humanoid_sim.ros2.definitions import EVENT, TICK

INTENT_CODES = {intent: code for code, intent in enumerate(Intent)}  # `INTENT_…` of the message definition
_INTENTS = tuple(Intent)
_NO_POLICY = bytes([1, 0, 0, 0, 0])  # an empty string


def encode_tick(record: TickRecord) -> bytes:
    """Return the message of one tick."""
    given, output = record.input, record.output
    state, control = given.state, output.control_mode
    step, standby, remote = output.policy_step, output.standby, given.remote
    steps, standbys, remotes = [], [], []
    if step is not None:
        steps.append(((step.frame,), step.observation, step.action.ravel(), step.action.shape))
    if standby is not None:
        numbers = standby.progress, standby.current_segment, standby.total_segments, standby.is_finished
        standbys.append((numbers,))
    if remote is not None:
        remotes.append(((remote.arrival_time,), *_fields(remote.command)))
    return encode(
        TICK,
        (
            *(record.index, state.time, record.duration),
            *state.imu_quaternion.tolist(),
            *state.imu_angular_velocity.tolist(),
            *state.imu_linear_acceleration.tolist(),
            *(record.overrun, output.quit, record.qpos is not None, control.mode),
        ),
        state.joint_position,
        state.joint_velocity,
        state.joint_effort,
        state.joint_age,
        *_fields(output.command),
        () if record.qpos is None else record.qpos,
        steps,
        standbys,
        remotes,
        [(name, (e.arrival_time, e.timeout), e.value.shape, e.value.ravel()) for name, e in state.extern.items()],
        control.controller_name,
        control.status_message,
        [((status.flags, status.level), status.source, status.message) for status in given.safety],
        [INTENT_CODES[intent] for intent in given.intents],
        [(fault.controller, fault.fallback, fault.message, (fault.is_bug,)) for fault in output.faults],
        output.refusals,
        () if output.policy_error is None else (output.policy_error,),
        given.policy,
    )


def _fields(command: MITCommand) -> list[Any]:
    return [getattr(command, name) for name in COMMAND_FIELDS]


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
