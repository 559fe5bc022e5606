"""A Robstride motor's firmware as a pure state machine: frames, time and sensors in; frames and a new state out.

What the manuals leave open is decided here, each at its place: which frames feed the CAN timeout (any for this motor),
what a motor with a latched fault does when it is enabled (it answers, and stays in reset mode), when a fault report is
sent unasked (when its words change), what a write to an unknown parameter does (nothing, but it is answered). None of
this was compared with a motor. Of the run modes only operation, the MIT law, is emulated: a motor that was set to
another one answers an enable like one with a latched fault, and stays in reset mode.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TypeVar

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.emulated_motor import Drive, Reaction, Sensed
from humanoid_sim.hardware.robstride import messages
from humanoid_sim.hardware.robstride.codec import LARGEST_MOTOR_ID, decode_command, encode_command, encode_reply
from humanoid_sim.hardware.robstride.firmware import Firmware, FirmwareVersion
from humanoid_sim.hardware.robstride.messages import (
    DEFAULT_HOST_ID,
    BaudRate,
    FaultBit,
    MotorMode,
    OperationControl,
    Protocol,
    StatusFault,
    WarningBit,
    flag_names,
)
from humanoid_sim.hardware.robstride.parameters import (
    PARAMETERS,
    PARAMETERS_BY_INDEX,
    CanTimeout,
    RunMode,
    default_value,
    fault_word,
    function_codes,
    pack_value,
    report_interval,
    unpack_value,
)
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.motors import POSITION_RANGE, MotorModel

NO_STATUS_FAULT = StatusFault(0)
NO_FAULT = FaultBit(0)
NO_WARNING = WarningBit(0)


@dataclass(frozen=True, slots=True)
class MotorIdentity:
    """A motor as it left the factory, with its firmware."""

    model: MotorModel
    """With this firmware's position range."""
    uid: bytes
    """8 bytes."""
    version: FirmwareVersion
    firmware: Firmware
    """Differences of this version from others."""
    stall_time: float = 2.0
    """s at the torque limit without motion after which the overload protection trips; infinity: never. The manuals
    name the protection, not its rule."""
    write_only: bool = False
    """True if it does not tell its parameters 0x7021 to 0x7029, which some manuals list as write-only."""

    @property
    def keeps_target(self) -> bool:
        """Return whether setting the zero leaves the position target, so that a motor that holds a position jumps.

        The firmware notes say "old firmware" without a number: taken to be that with the old position range.
        """
        return self.firmware.position_range != POSITION_RANGE

    @property
    def torque_per_ampere(self) -> float:
        """N·m/A, of phase current. Not stated anywhere: peak torque at peak current, and proportional below."""
        return self.model.peak_torque / self.model.peak_current


@dataclass(frozen=True, slots=True)
class Stored:
    """Data that survives without power."""

    can_id: int
    parameters: Mapping[int, float] = field(default_factory=lambda: MappingProxyType({}))
    """Saved values by index; what is not in it has its default."""
    zero: float = 0.0
    """rad, the shaft's angle, up to whole turns, that counts as 0."""
    baud_rate: BaudRate = BaudRate.KBIT_1000
    protocol: Protocol = Protocol.PRIVATE


@dataclass(frozen=True, slots=True)
class MotorState:
    """A motor between two events. Times are s on the emulator's clock."""

    can_id: int
    stored: Stored
    parameters: Mapping[int, float]
    """Present values by index."""
    origin: float
    """rad, the shaft's angle that counts as position 0, turns included."""
    mode: MotorMode = MotorMode.RESET
    command: OperationControl | None = None
    """Command in force in operation mode; None: no torque. As decoded, before the firmware's gain factor."""
    host_id: int = DEFAULT_HOST_ID
    """Host that it answers. Operation control frames have no room for the host's id, and where the motor takes it from
    is not documented: here it is the last host that sent any other command."""
    heard: float = -math.inf
    """Time at which the last frame for this motor came: of any type, which is not documented either."""
    status_faults: StatusFault = NO_STATUS_FAULT
    """Latched until they are cleared."""
    faults: FaultBit = NO_FAULT
    """Latched likewise."""
    warnings: WarningBit = NO_WARNING
    next_report: float = math.inf
    """Time at which the next active report is due; infinity: they are off."""
    overloaded_since: float = math.inf
    """Time at which the torque reached its limit without motion; infinity: it has not."""
    is_deaf: bool = False
    """True once it was set to another protocol or bit rate, and does not understand this bus."""

    @property
    def is_running(self) -> bool:
        """Return whether it is enabled."""
        return self.mode is MotorMode.RUN


_WRITE_ONLY = range(0x7021, 0x702A)
_FIRST_NEWER = 0x702A
"""From here on newer firmware only; the first of them is missing on the rs-05."""
_UNKNOWN_VELOCITY = 10.0
"""rad/s, of limit_spd: no document gives its default."""


def initial_parameters(identity: MotorIdentity, saved: Mapping[int, float]) -> Mapping[int, float]:
    """Values of all writable parameters after power-on, by index."""
    values: dict[int, float] = {}
    for index, known in PARAMETERS_BY_INDEX.items():
        if known.is_writable and _exists(identity, index):
            default = default_value(known, identity.model.name)
            unknown = _UNKNOWN_VELOCITY if known.name == "limit_spd" else 0.0
            values[index] = unknown if default is None else default
    return MappingProxyType({**values, **saved})


def parameter(state: MotorState, name: str) -> float:
    """Return the present value of a writable parameter by its name."""
    return state.parameters[PARAMETERS[name].index]


def read_parameter(identity: MotorIdentity, state: MotorState, sensed: Sensed, index: int) -> bytes | None:
    """Return the 4 bytes that a read of an index answers with; none: there is no such parameter."""
    word = fault_word(identity.model.name)
    if index == word.index:
        return pack_value(word.type, int(state.faults))
    live = {
        "mechPos": sensed.shaft - state.origin,
        "mechVel": sensed.velocity,
        "iqf": sensed.torque / identity.torque_per_ampere,
        "VBUS": sensed.voltage,
        "torque_fdb": sensed.torque,
    }
    function = function_codes(identity.model.name).get(index)
    if function is not None and function.name in live:
        return pack_value(function.type, live[function.name])
    known = PARAMETERS_BY_INDEX.get(index)
    if known is None or not _exists(identity, index) or (identity.write_only and index in _WRITE_ONLY):
        return None
    value = live[known.name] if known.name in live else state.parameters[index]
    return pack_value(known.type, value)


def written_parameters(state: MotorState, index: int, payload: bytes) -> Mapping[int, float]:
    """All values after a write. One that is read only, unknown, or not accepted now, changes nothing.

    Values are taken as they are, also beyond the manual's ranges: that a motor cuts them off is not documented, and
    what the hardware cannot do it does not do whatever they say.
    """
    known = PARAMETERS_BY_INDEX.get(index)
    if known is None or index not in state.parameters:
        return state.parameters
    value = float(unpack_value(known.type, payload))
    if math.isnan(value):
        return state.parameters
    if known.name == "run_mode" and (state.is_running or value not in tuple(RunMode)):
        return state.parameters
    return MappingProxyType({**state.parameters, index: value})


def _exists(identity: MotorIdentity, index: int) -> bool:
    if index < _FIRST_NEWER:
        return True
    return identity.firmware.has_active_reports and not (index == _FIRST_NEWER and identity.model.name == "rs-05")


_LEAST_VOLTAGE = 12.0
"""V, below which the motor reports undervoltage; likewise the manuals' 60 V."""
_MOST_VOLTAGE = 60.0
_STILL = 0.05
"""rad/s below which a shaft that is driven with all its torque counts as stalled."""
_FOREIGN_HOST = 0xAA
"""Id of the other computer that asks."""

Angle = TypeVar("Angle", float, FloatArray)


def wrapped(position: Angle, position_range: Angle) -> Angle:
    """Return a position in [-range, range), or an array of them: feedback runs cyclically, it does not saturate."""
    return (position + position_range) % (2.0 * position_range) - position_range


class RobstrideFirmware:
    """See `Firmware`."""

    def __init__(self, identity: MotorIdentity, can_id: int) -> None:
        """Make a motor with its id, everything else as it comes."""
        self.identity = identity
        self.model = identity.model
        self._stored = Stored(can_id)

    def power_on(self, before: MotorState | None, sensed: Sensed) -> MotorState:
        """See `Firmware`: not enabled, parameters as saved, turns lost.

        Its encoder tells the angle within one turn only, so the first position lies in 0 to 2π, or in -π to π with
        `zero_sta` 1.
        """
        stored = self._stored if before is None else before.stored
        parameters = initial_parameters(self.identity, stored.parameters)
        state = MotorState(can_id=stored.can_id, stored=stored, parameters=parameters, origin=stored.zero)
        lowest = -math.pi if parameter(state, "zero_sta") else 0.0
        zero = stored.zero - parameters.get(0x702B, 0.0)  # add_offset takes effect here
        position = lowest + (sensed.shaft - zero - lowest) % (2.0 * math.pi)
        understood = messages.Protocol.PRIVATE, messages.BaudRate.KBIT_1000
        return replace(state, origin=sensed.shaft - position, is_deaf=(stored.protocol, stored.baud_rate) != understood)

    def reset(self, state: MotorState) -> MotorState:
        """See `Firmware`."""
        return replace(state, mode=MotorMode.RESET, command=None, overloaded_since=math.inf)

    def is_for(self, state: MotorState, frame: Frame) -> bool:
        """See `Firmware`: whether a frame's last byte is its id."""
        return frame.arbitration_id & 0xFF == state.can_id

    def receive(self, state: MotorState, frame: Frame, sensed: Sensed, time: float) -> Reaction[MotorState]:
        """See `Firmware`: what is for another motor, or cannot be read, changes nothing."""
        if state.is_deaf:
            return Reaction(state)
        command = decode_command(frame, state.can_id, self.identity.model)
        if isinstance(command, messages.Ignored | messages.Malformed):
            return Reaction(state)
        if isinstance(command, messages.OperationControl):  # by far the most frequent
            state = replace(state, heard=time, command=command if state.is_running else None)
            return Reaction(state, (self._frame(self._status(state, sensed)),))
        state = replace(state, heard=time, host_id=command.host_id)
        state, reply = self._obey(state, command, sensed, time)
        refusal = "" if state.is_running or not isinstance(command, messages.Enable) else _refusal(state)
        return Reaction(state, () if reply is None else (self._frame(reply),), refusal)

    def advance(self, state: MotorState, sensed: Sensed, time: float) -> Reaction[MotorState]:
        """See `Firmware`: its protections, the CAN timeout, active reports."""
        frames: list[Frame] = []
        before = state.faults, state.warnings
        state = self._protect(self._watch_stall(state, sensed, time), sensed, time)
        if (state.faults, state.warnings) != before:
            frames.append(self._frame(messages.FaultReport(state.can_id, state.host_id, state.faults, state.warnings)))
        if state.is_running and time >= _timeout_at(state):
            # Only the mode bits tell: whether a fault bit is set as well is not documented.
            state = self.reset(state)
        if time >= state.next_report:
            is_report = not self.identity.firmware.reports_as_status
            frames.append(self._frame(self._status(state, sensed, is_report=is_report)))
            interval = _report_interval(state)
            state = replace(state, next_report=max(state.next_report + interval, time + 0.5 * interval))
        return Reaction(state, () if state.is_deaf else tuple(frames))

    def next_time(self, state: MotorState) -> float:
        """See `Firmware`."""
        return min(state.next_report, _timeout_at(state) if state.is_running else math.inf)

    def drive(self, state: MotorState) -> Drive:
        """See `Firmware`."""
        limit, command = self._torque_limit(state), state.command
        if not state.is_running or command is None:
            return Drive(0.0, 0.0, 0.0, 0.0, 0.0, limit, state.origin)
        factor = self.identity.firmware.gain_factor
        stiffness, damping = factor * command.stiffness, factor * command.damping
        return Drive(command.position, command.velocity, command.effort, stiffness, damping, limit, state.origin)

    def changes(self, before: MotorState, state: MotorState) -> tuple[str, ...]:
        """See `Firmware`."""
        lines = []
        if state.mode is not before.mode:
            lines.append("enabled" if state.is_running else "stopped, in reset mode")
        if state.status_faults != before.status_faults or state.faults != before.faults:
            names = dict.fromkeys((*flag_names(state.status_faults), *flag_names(state.faults)))
            lines.append(", ".join(names) or "faults cleared")
        return tuple(lines)

    def announcement(self, state: MotorState) -> tuple[Frame, ...]:
        """See `Firmware`: a device id, as drivers report of real ones."""
        return () if state.is_deaf else (self._frame(self._device_id(state)),)

    def zero_torque(self, state: MotorState) -> tuple[Frame, ...]:
        """See `Firmware`."""
        return (encode_command(messages.OperationControl(state.can_id, 0.0, 0.0, 0.0, 0.0, 0.0), self.identity.model),)

    def question(self, state: MotorState) -> tuple[Frame, ...]:
        """See `Firmware`: for mechPos."""
        question = messages.ReadParameter(state.can_id, PARAMETERS["mechPos"].index, host_id=_FOREIGN_HOST)
        return (encode_command(question, self.identity.model),)

    def _status(self, state: MotorState, sensed: Sensed, *, is_report: bool = False) -> messages.Status:
        """Return what the motor says about itself at this instant."""
        return messages.Status(
            state.can_id,
            state.host_id,
            wrapped(sensed.shaft - state.origin, self.identity.model.position),
            sensed.velocity,
            sensed.torque,
            sensed.temperature,
            state.mode,
            state.status_faults,
            is_report,
        )

    def _torque_limit(self, state: MotorState) -> float:
        """N·m at which the motor's torque is cut off in operation mode.

        No manual states that `limit_torque` holds there; Berkeley's documentation calls it firmware-enforced. The phase
        current's peak holds in any case.
        """
        return min(max(parameter(state, "limit_torque"), 0.0), self.identity.model.peak_torque)

    def _device_id(self, state: MotorState) -> messages.DeviceId:
        return messages.DeviceId(state.can_id, self.identity.uid)

    def _frame(self, reply: messages.Reply) -> Frame:
        return encode_reply(reply, self.identity.model)

    def _present_faults(self, state: MotorState, sensed: Sensed, time: float) -> tuple[StatusFault, FaultBit]:
        """Say what is wrong now. Overvoltage has no status bit, and an encoder fault none in the fault report."""
        in_status, in_report = NO_STATUS_FAULT, NO_FAULT
        if sensed.temperature >= self.identity.model.fault_temperature:
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
        if sensed.overloaded or time - state.overloaded_since >= self.identity.stall_time:
            in_status |= StatusFault.STALL_OVERLOAD
            in_report |= FaultBit.STALL_OVERLOAD
        return in_status, in_report

    def _watch_stall(self, state: MotorState, sensed: Sensed, time: float) -> MotorState:
        limit = self._torque_limit(state)
        is_stalled = state.is_running and abs(sensed.velocity) < _STILL and abs(sensed.torque) >= 0.99 * limit > 0.0
        if is_stalled == math.isfinite(state.overloaded_since):
            return state
        return replace(state, overloaded_since=time if is_stalled else math.inf)

    def _protect(self, state: MotorState, sensed: Sensed, time: float) -> MotorState:
        """Latch what is wrong; a motor with any fault stops."""
        in_status, in_report = self._present_faults(state, sensed, time)
        hot = sensed.temperature >= self.identity.model.warning_temperature
        warnings = WarningBit.MOTOR_OVERTEMPERATURE_WARNING if hot else NO_WARNING
        if state.status_faults is not in_status or state.faults is not in_report:  # flags are slow to combine
            in_status |= state.status_faults
            in_report |= state.faults
        if (in_status, in_report, warnings) != (state.status_faults, state.faults, state.warnings):
            state = replace(state, status_faults=in_status, faults=in_report, warnings=warnings)
        return self.reset(state) if state.is_running and (in_status or in_report) else state

    def _obey(  # noqa: PLR0911, PLR0912 - one case for each command
        self, state: MotorState, command: messages.Command, sensed: Sensed, time: float
    ) -> tuple[MotorState, messages.Reply | None]:
        match command:
            case messages.GetDeviceId():
                return state, self._device_id(state)
            case messages.Enable():
                if not (state.status_faults or state.faults or state.is_running or _refusal(state)):
                    state = replace(state, mode=MotorMode.RUN, command=None)
            case messages.Stop(clear_fault=clear):
                state = self.reset(state)
                if clear:
                    state = self._protect(replace(state, status_faults=NO_STATUS_FAULT, faults=NO_FAULT), sensed, time)
            case messages.ReadVersion():
                return state, messages.Version(state.can_id, state.host_id, self.identity.version)
            case messages.SetZero():
                state = self._with_zero(state, sensed)
            case messages.SetDeviceId(new_id=new_id):
                if not 1 <= new_id <= LARGEST_MOTOR_ID:
                    return state, None
                state = replace(state, can_id=new_id, stored=replace(state.stored, can_id=new_id))
                return state, self._device_id(state)
            case messages.ReadParameter(index=index):
                payload = read_parameter(self.identity, state, sensed, index)
                known = payload is not None
                return state, messages.ParameterReply(state.can_id, state.host_id, index, payload or bytes(4), known)
            case messages.WriteParameter(index=index, payload=payload):
                state = replace(state, parameters=written_parameters(state, index, payload))
            case messages.SaveParameters():
                state = replace(state, stored=replace(state.stored, parameters=state.parameters, zero=state.origin))
            case messages.SetActiveReport(is_on=is_on):
                if not self.identity.firmware.has_active_reports:
                    return state, None
                state = replace(state, next_report=time + _report_interval(state) if is_on else math.inf)
            case messages.SetBaudRate(baud_rate=rate):
                state = replace(state, stored=replace(state.stored, baud_rate=rate))
                return state, self._device_id(state)
            case messages.SetProtocol(protocol=protocol):
                state = replace(state, stored=replace(state.stored, protocol=protocol))
                return state, self._device_id(state)
        return state, self._status(state, sensed)

    def _with_zero(self, state: MotorState, sensed: Sensed) -> MotorState:
        """Make the present position zero; position mode PP ignores it."""
        if parameter(state, "run_mode") == RunMode.PROFILE_POSITION:
            return state
        command = state.command
        if command is not None and not self.identity.keeps_target:
            command = replace(command, position=0.0)
        return replace(state, origin=sensed.shaft, command=command)


def _refusal(state: MotorState) -> str:
    """Return why the motor cannot be enabled, in words; empty: it can, or its faults say why not."""
    mode = RunMode(int(parameter(state, "run_mode")))
    return "" if mode is RunMode.OPERATION else f"not enabled: run_mode is {mode}, only 0 (operation) is emulated"


def _timeout_at(state: MotorState) -> float:
    ticks = parameter(state, "canTimeout")
    return state.heard + CanTimeout.to_seconds(int(ticks)) if ticks > 0 else math.inf


def _report_interval(state: MotorState) -> float:
    return report_interval(max(int(parameter(state, "EPScan_time")), 1))
