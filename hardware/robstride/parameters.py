"""The motors' parameters: their numbers, types and units, and how values become the 4 bytes of types 17 and 18.

Those of other run modes than operation, which nothing here uses, are left out; the others are the same for all models.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from humanoid_sim.errors import FieldError, InputError, known_names


class ParameterType(Enum):
    """Type of a value; the enum's value is its `struct` format."""

    U8 = "<B"
    I8 = "<b"
    U16 = "<H"
    I16 = "<h"
    U32 = "<I"
    I32 = "<i"
    F32 = "<f"


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter."""

    index: int
    name: str
    type: ParameterType
    unit: str = ""
    is_writable: bool = True
    default: float | None = None  # as delivered; None: the documents do not say, or models differ
    meaning: str = ""
    accepted: tuple[float, float] = (-math.inf, math.inf)  # lowest and highest that the documents allow

    @property
    def is_float(self) -> bool:
        return self.type is ParameterType.F32

    def is_same(self, value: float, other: float) -> bool:
        """Tell whether two values are one to the motor: 12.1 and the float32 next to it are. NaN is not even itself."""
        return math.isfinite(value) and pack_value(self.type, value) == pack_value(self.type, other)


def pack_value(kind: ParameterType, value: float) -> bytes:
    """Return a value's 4 bytes: little-endian, left-aligned, the rest zero; a `FieldError` if it does not fit."""
    is_float = kind is ParameterType.F32
    try:
        if math.isfinite(value) and (is_float or value == int(value)):
            return struct.pack(kind.value, value if is_float else int(value)).ljust(4, b"\0")
    except (struct.error, OverflowError):
        pass
    raise FieldError(f"parameter: is {value}, expected a {'finite' if is_float else 'whole'} number of {kind.name}")


def unpack_value(kind: ParameterType, payload: bytes) -> int | float:
    """Return the value in 4 bytes, of which only as many count as the type has; a float may be NaN or infinite."""
    value: int | float = struct.unpack_from(kind.value, payload)[0]
    return value


OPERATION_MODE, PROFILE_POSITION_MODE = 0, 1  # values of `run_mode`; operation is the MIT law, which all here uses
CAN_TIMEOUT_TICK = 50e-6  # s, in which the manuals count `canTimeout`
LONGEST_CAN_TIMEOUT = 100_000  # ticks: the stored one's maximum

_U8, _U16, _U32, _F32 = ParameterType.U8, ParameterType.U16, ParameterType.U32, ParameterType.F32
_STOPS = "without a command for so long the motor stops; 0: never"

_PARAMETERS = (
    Parameter(0x7005, "run_mode", _U8, "", True, 0, "0 operation (MIT), 1 PP, 2 velocity, 3 current, 5 CSP", (0, 5)),
    Parameter(0x700B, "limit_torque", _F32, "N·m", True, None, "torque limit", (0.0, 120.0)),  # the strongest model's
    Parameter(0x7010, "cur_kp", _F32, "", True, 0.17, "current loop"),
    Parameter(0x7011, "cur_ki", _F32, "", True, 0.012, "current loop"),
    Parameter(0x7014, "cur_filter_gain", _F32, "", True, 0.1, "current filter, 0 to 1", (0.0, 1.0)),
    Parameter(0x7018, "limit_cur", _F32, "A", True, None, "current limit of other modes than operation", (0.0, 90.0)),
    Parameter(0x7019, "mechPos", _F32, "rad", False, None, "position of the output, with its turns"),
    Parameter(0x701A, "iqf", _F32, "A", False, None, "filtered current"),
    Parameter(0x701B, "mechVel", _F32, "rad/s", False, None, "velocity of the output"),
    Parameter(0x701C, "VBUS", _F32, "V", False, None, "supply voltage"),
    Parameter(0x7026, "EPScan_time", _U16, "", True, 1, "report interval: 10 ms + 5 ms for each above 1", (1, 0xFFFF)),
    Parameter(0x7028, "canTimeout", _U32, "50 µs", True, 0, _STOPS, (0, LONGEST_CAN_TIMEOUT)),
    Parameter(0x7029, "zero_sta", _U8, "", True, 0, "position at power-on: 0 in 0 to 2π, 1 in -π to π", (0, 1)),
    # 1 takes a protection away and gives nothing: nobody says that it makes a motor brake after its CAN timeout.
    Parameter(0x702A, "damper", _U8, "", True, 0, "0: resists fast turning without power; not rs-05", (0, 0)),
    Parameter(0x702B, "add_offset", _F32, "rad", True, None, "newer firmware: shifts zero at the next power-on"),
    Parameter(0x702C, "alveolous_open", _U8, "", True, None, "newer firmware: 1 compensates cogging", (0, 1)),
    Parameter(0x702D, "iq_test", _U8, "", True, None, "newer firmware: 1 calibrates more exactly at power-on", (0, 1)),
)
PARAMETERS: Mapping[str, Parameter] = {parameter.name: parameter for parameter in _PARAMETERS}  # by the manuals' names
PARAMETERS_BY_INDEX: Mapping[int, Parameter] = {parameter.index: parameter for parameter in _PARAMETERS}


def check_value(parameter: Parameter, value: float) -> None:
    """Refuse, by `InputError`, a value that the documents do not allow."""
    lowest, highest = parameter.accepted
    if not (lowest <= value <= highest and (parameter.is_float or value.is_integer())):
        kind = "a number" if parameter.is_float else "a whole number"
        raise InputError(f"{parameter.name}: is {value:g}, expected {kind}, {lowest:g} to {highest:g}")


def find_parameter(name_or_index: str) -> Parameter:
    """Return a parameter by its name in any case, or by its index such as `0x7019`; the `InputError` lists them."""
    for parameter in PARAMETERS.values():
        if name_or_index.lower() in (parameter.name.lower(), f"0x{parameter.index:x}"):
            return parameter
    raise InputError(known_names("parameter", name_or_index, PARAMETERS))


def fault_word(model: str) -> Parameter:
    """Return the 32-bit fault word (`FaultBit`) as a parameter: it shows overvoltage, which no status does."""
    return Parameter(0x3023 if model == "rs-04" else 0x3022, "fault_word", _U32, "", False)


def report_interval(scan_time: int) -> float:
    """Return the time between active reports, s, for a value of `EPScan_time` of 1 or more."""
    return 0.010 + 0.005 * (scan_time - 1)
