"""A Robstride motor's firmware as a pure state machine: frames, time and sensors in; frames and a new state out.

What the manuals leave open is decided here, each at its place: which frames feed the CAN timeout (any for this motor),
what a motor with a latched fault does when it is enabled (it answers, and stays in reset mode), when a fault report is
sent unasked (when its words change), what a write to an unknown parameter does (nothing, but it is answered). None of
this was compared with a motor. Of the run modes only operation, the MIT law, is emulated: a motor that was set to
another one answers an enable like one with a latched fault, and stays in reset mode.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TypeVar

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.emulated_motor import Reaction, Sensed
from humanoid_sim.hardware.emulation.motor_state import (
    NO_FAULT,
    NO_STATUS_FAULT,
    NO_WARNING,
    MotorIdentity,
    MotorState,
    Stored,
    initial_parameters,
    parameter,
    read_parameter,
    written_parameters,
)
from humanoid_sim.hardware.robstride.commands import decode_command
from humanoid_sim.hardware.robstride.fields import FaultBit, MotorMode, StatusFault, WarningBit
from humanoid_sim.hardware.robstride.messages import (
    BaudRate,
    Command,
    DeviceId,
    Enable,
    FaultReport,
    GetDeviceId,
    Ignored,
    Malformed,
    OperationControl,
    ParameterReply,
    Protocol,
    ReadParameter,
    ReadVersion,
    Reply,
    SaveParameters,
    SetActiveReport,
    SetBaudRate,
    SetDeviceId,
    SetProtocol,
    SetZero,
    Status,
    Stop,
    Version,
    WriteParameter,
)
from humanoid_sim.hardware.robstride.parameters import CanTimeout, RunMode, report_interval
from humanoid_sim.hardware.robstride.replies import encode_reply
from humanoid_sim.mit import FloatArray

_LEAST_VOLTAGE = 12.0
"""V, below which the motor reports undervoltage; likewise the manuals' 60 V."""
_MOST_VOLTAGE = 60.0
_STILL = 0.05
"""rad/s below which a shaft that is driven with all its torque counts as stalled."""
_LARGEST_ID = 127


Angle = TypeVar("Angle", float, FloatArray)


def power_on(identity: MotorIdentity, stored: Stored, sensed: Sensed) -> MotorState:
    """Return a motor that has just booted: not enabled, parameters as saved, turns lost.

    Its encoder tells the angle within one turn only, so the first position lies in 0 to 2π, or in -π to π with
    `zero_sta` 1.
    """
    parameters = initial_parameters(identity, stored.parameters)
    state = MotorState(can_id=stored.can_id, stored=stored, parameters=parameters, origin=stored.zero)
    lowest = -math.pi if parameter(state, "zero_sta") else 0.0
    zero = stored.zero - parameters.get(0x702B, 0.0)  # add_offset takes effect here
    position = lowest + (sensed.shaft - zero - lowest) % (2.0 * math.pi)
    is_deaf = stored.protocol is not Protocol.PRIVATE or stored.baud_rate is not BaudRate.KBIT_1000
    return replace(state, origin=sensed.shaft - position, is_deaf=is_deaf)


def wrapped(position: Angle, position_range: Angle) -> Angle:
    """Return a position in [-range, range), or an array of them: feedback runs cyclically, it does not saturate."""
    return (position + position_range) % (2.0 * position_range) - position_range


def status(identity: MotorIdentity, state: MotorState, sensed: Sensed, *, is_report: bool = False) -> Status:
    """Return what the motor says about itself at this instant."""
    return Status(
        state.can_id,
        state.host_id,
        wrapped(sensed.shaft - state.origin, identity.model.position),
        sensed.velocity,
        sensed.torque,
        sensed.temperature,
        state.mode,
        state.status_faults,
        is_report,
    )


def torque_limit(identity: MotorIdentity, state: MotorState) -> float:
    """N·m at which the motor's torque is cut off in operation mode.

    No manual states that `limit_torque` holds there; Berkeley's documentation calls it firmware-enforced. The phase
    current's peak holds in any case.
    """
    return min(max(parameter(state, "limit_torque"), 0.0), identity.model.peak_torque)


def receive(
    identity: MotorIdentity, state: MotorState, frame: Frame, sensed: Sensed, time: float
) -> Reaction[MotorState]:
    """Return a frame from the bus, at `time`, s. What is for another motor, or cannot be read, changes nothing."""
    if state.is_deaf:
        return Reaction(state)
    command = decode_command(frame, state.can_id, identity.model, scale=identity.scale)
    if isinstance(command, Ignored | Malformed):
        return Reaction(state)
    if isinstance(command, OperationControl):  # by far the most frequent
        state = replace(state, heard=time, command=command if state.is_running else None)
        return Reaction(state, (_frame(identity, status(identity, state, sensed)),))
    state = replace(state, heard=time, host_id=command.host_id)
    state, reply = _obey(identity, state, command, sensed, time)
    refusal = "" if state.is_running or not isinstance(command, Enable) else _refusal(state)
    return Reaction(state, () if reply is None else (_frame(identity, reply),), refusal)


def _refusal(state: MotorState) -> str:
    """Return why the motor cannot be enabled, in words; empty: it can, or its faults say why not."""
    mode = RunMode(int(parameter(state, "run_mode")))
    return "" if mode is RunMode.OPERATION else f"not enabled: run_mode is {mode}, only 0 (operation) is emulated"


def advance(identity: MotorIdentity, state: MotorState, sensed: Sensed, time: float) -> Reaction[MotorState]:
    """Return what the motor does of itself at `time`: its protections, the CAN timeout, active reports."""
    frames: list[Frame] = []
    before = state.faults, state.warnings
    state = _protect(identity, _watch_stall(identity, state, sensed, time), sensed, time)
    if (state.faults, state.warnings) != before:
        frames.append(_frame(identity, FaultReport(state.can_id, state.host_id, state.faults, state.warnings)))
    if state.is_running and time >= _timeout_at(state):
        # Only the mode bits tell: whether a fault bit is set as well is not documented.
        state = _stopped(state)
    if time >= state.next_report:
        is_report = not identity.firmware.reports_as_status
        frames.append(_frame(identity, status(identity, state, sensed, is_report=is_report)))
        interval = _report_interval(state)
        state = replace(state, next_report=max(state.next_report + interval, time + 0.5 * interval))
    return Reaction(state, () if state.is_deaf else tuple(frames))


def next_time(state: MotorState) -> float:
    """s, when `advance` has something to do at the latest, protections apart; infinity: never."""
    return min(state.next_report, _timeout_at(state) if state.is_running else math.inf)


def _frame(identity: MotorIdentity, reply: Reply) -> Frame:
    return encode_reply(reply, identity.model, scale=identity.scale)


def _timeout_at(state: MotorState) -> float:
    ticks = parameter(state, "canTimeout")
    return state.heard + CanTimeout.to_seconds(int(ticks)) if ticks > 0 else math.inf


def _report_interval(state: MotorState) -> float:
    return report_interval(max(int(parameter(state, "EPScan_time")), 1))


def _stopped(state: MotorState) -> MotorState:
    return replace(state, mode=MotorMode.RESET, command=None, overloaded_since=math.inf)


def _present_faults(
    identity: MotorIdentity, state: MotorState, sensed: Sensed, time: float
) -> tuple[StatusFault, FaultBit]:
    """Say what is wrong now. Overvoltage has no status bit, and an encoder fault none in the fault report."""
    in_status, in_report = NO_STATUS_FAULT, NO_FAULT
    if sensed.temperature >= identity.model.fault_temperature:
        in_status |= StatusFault.MOTOR_OVERTEMPERATURE
        in_report |= FaultBit.MOTOR_OVERTEMPERATURE
    if sensed.voltage < _LEAST_VOLTAGE:
        in_status |= StatusFault.UNDERVOLTAGE
        in_report |= FaultBit.UNDERVOLTAGE
    if sensed.voltage > _MOST_VOLTAGE:
        in_report |= FaultBit.OVERVOLTAGE
    if sensed.encoder_fault:
        in_status |= StatusFault.ENCODER_FAULT
    if sensed.overcurrent:
        in_status |= StatusFault.PHASE_OVERCURRENT
        in_report |= FaultBit.PHASE_A_OVERCURRENT
    if sensed.overloaded or time - state.overloaded_since >= identity.stall_time:
        in_status |= StatusFault.STALL_OVERLOAD
        in_report |= FaultBit.STALL_OVERLOAD
    return in_status, in_report


def _watch_stall(identity: MotorIdentity, state: MotorState, sensed: Sensed, time: float) -> MotorState:
    limit = torque_limit(identity, state)
    is_stalled = state.is_running and abs(sensed.velocity) < _STILL and abs(sensed.torque) >= 0.99 * limit > 0.0
    if is_stalled == math.isfinite(state.overloaded_since):
        return state
    return replace(state, overloaded_since=time if is_stalled else math.inf)


def _protect(identity: MotorIdentity, state: MotorState, sensed: Sensed, time: float) -> MotorState:
    """Latch what is wrong; a motor with any fault stops."""
    in_status, in_report = _present_faults(identity, state, sensed, time)
    hot = sensed.temperature >= identity.model.warning_temperature
    warnings = WarningBit.MOTOR_OVERTEMPERATURE_WARNING if hot else NO_WARNING
    if state.status_faults is not in_status or state.faults is not in_report:  # flags are slow to combine
        in_status |= state.status_faults
        in_report |= state.faults
    if (in_status, in_report, warnings) != (state.status_faults, state.faults, state.warnings):
        state = replace(state, status_faults=in_status, faults=in_report, warnings=warnings)
    return _stopped(state) if state.is_running and (in_status or in_report) else state


def _obey(  # noqa: PLR0911, PLR0912 - one case for each command
    identity: MotorIdentity, state: MotorState, command: Command, sensed: Sensed, time: float
) -> tuple[MotorState, Reply | None]:
    match command:
        case GetDeviceId():
            return state, DeviceId(state.can_id, identity.uid)
        case Enable():
            if not (state.status_faults or state.faults or state.is_running or _refusal(state)):
                state = replace(state, mode=MotorMode.RUN, command=None)
        case Stop(clear_fault=clear):
            state = _stopped(state)
            if clear:
                state = _protect(identity, replace(state, status_faults=NO_STATUS_FAULT, faults=NO_FAULT), sensed, time)
        case ReadVersion():
            return state, Version(state.can_id, state.host_id, identity.version)
        case SetZero():
            state = _with_zero(identity, state, sensed)
        case SetDeviceId(new_id=new_id):
            if not 1 <= new_id <= _LARGEST_ID:
                return state, None
            state = replace(state, can_id=new_id, stored=replace(state.stored, can_id=new_id))
            return state, DeviceId(new_id, identity.uid)
        case ReadParameter(index=index):
            payload = read_parameter(identity, state, sensed, index)
            reply = ParameterReply(state.can_id, state.host_id, index, payload or bytes(4), payload is not None)
            return state, reply
        case WriteParameter(index=index, payload=payload):
            state = replace(state, parameters=written_parameters(state, index, payload))
        case SaveParameters():
            state = replace(state, stored=replace(state.stored, parameters=state.parameters, zero=state.origin))
        case SetActiveReport(is_on=is_on):
            if not identity.firmware.has_active_reports:
                return state, None
            state = replace(state, next_report=time + _report_interval(state) if is_on else math.inf)
        case SetBaudRate(baud_rate=rate):
            state = replace(state, stored=replace(state.stored, baud_rate=rate))
            return state, DeviceId(state.can_id, identity.uid)
        case SetProtocol(protocol=protocol):
            state = replace(state, stored=replace(state.stored, protocol=protocol))
            return state, DeviceId(state.can_id, identity.uid)
    return state, status(identity, state, sensed)


def _with_zero(identity: MotorIdentity, state: MotorState, sensed: Sensed) -> MotorState:
    """Make the present position zero; position mode PP ignores it."""
    if parameter(state, "run_mode") == RunMode.PROFILE_POSITION:
        return state
    command = state.command
    if command is not None and not identity.keeps_target:
        command = replace(command, position=0.0)
    return replace(state, origin=sensed.shaft, command=command)
