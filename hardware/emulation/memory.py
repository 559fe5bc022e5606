"""A motor's parameters: what they are at first, what reading one gives, and what writing one changes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

from humanoid_sim.hardware.emulation.law import RunMode
from humanoid_sim.hardware.emulation.motor_state import MotorIdentity, MotorState, Sensed
from humanoid_sim.hardware.robstride.parameters import (
    PARAMETERS,
    PARAMETERS_BY_INDEX,
    ParameterType,
    default_value,
    fault_word,
    pack_value,
    unpack_value,
)

__all__ = ["initial_parameters", "parameter", "read_parameter", "written_parameters"]

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
    """The present value of a writable parameter by its name."""
    return state.parameters[PARAMETERS[name].index]


def read_parameter(identity: MotorIdentity, state: MotorState, sensed: Sensed, index: int) -> bytes | None:
    """The 4 bytes that a read of an index answers with; none: there is no such parameter."""
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
    function = _function_codes(identity.model.name).get(index)
    if function is not None:
        return pack_value(ParameterType.F32, live[function])
    known = PARAMETERS_BY_INDEX.get(index)
    if known is None or not _exists(identity, index):
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


def _function_codes(model: str) -> Mapping[int, str]:
    """The measurements among the function codes, which are numbered per model."""
    first = 0x3017 if model == "rs-04" else 0x3016
    torque = 0x302D if model in ("rs-01", "rs-06") else 0x302C
    return {first: "mechPos", first + 1: "mechVel", torque: "torque_fdb"}


def _exists(identity: MotorIdentity, index: int) -> bool:
    if index < _FIRST_NEWER:
        return True
    return identity.firmware.has_active_reports and not (index == _FIRST_NEWER and identity.model.name == "rs-05")
