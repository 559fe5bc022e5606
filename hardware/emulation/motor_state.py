"""Identity, readings and memory of an emulated motor: its state and its parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from humanoid_sim.hardware.emulated_motor import Sensed
from humanoid_sim.hardware.robstride.fields import FaultBit, MotorMode, Scale, StatusFault, WarningBit
from humanoid_sim.hardware.robstride.firmware import Firmware, FirmwareVersion
from humanoid_sim.hardware.robstride.messages import DEFAULT_HOST_ID, BaudRate, OperationControl, Protocol
from humanoid_sim.hardware.robstride.parameters import (
    PARAMETERS,
    PARAMETERS_BY_INDEX,
    RunMode,
    default_value,
    fault_word,
    function_codes,
    pack_value,
    unpack_value,
)
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
    scale: Scale = Scale.REFERENCE
    """Convention by which it reads and writes signed fields."""
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
