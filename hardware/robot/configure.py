"""What is written to the motors before they are enabled, and read back: mode, limits and the CAN timeout."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from humanoid_sim.hardware.robot.checks import CheckList
from humanoid_sim.hardware.robot.parameter_access import ParameterAccess, Unreadable
from humanoid_sim.hardware.robot.wiring import Wiring
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, CanTimeout

__all__ = ["configure", "read_supply"]

_OPERATION_MODE = 0
"""`run_mode` in which MIT commands are executed."""
_FLOAT32 = 1e-6
"""Relative; values travel as float32."""


def configure(wiring: Wiring, access: ParameterAccess, can_timeout: float, checks: CheckList) -> None:
    """Write run mode, limits and CAN timeout to stopped motors and verify them.

    Without a CAN timeout a motor executes its last command for ever when the host dies, so one that does not confirm it
    is not enabled; nor is one that would take another kind of command, or more torque than it was given.
    """
    joints = range(wiring.count)
    _write_exactly(wiring, access, "run_mode", dict.fromkeys(joints, float(_OPERATION_MODE)), checks)
    ticks = float(CanTimeout.to_ticks(can_timeout))
    _write_exactly(wiring, access, "canTimeout", dict.fromkeys(joints, ticks), checks)
    torque = {i: limit for i, limit in enumerate(wiring.torque_limit) if limit > 0.0}
    current = {i: limit for i, limit in enumerate(wiring.current_limit) if limit > 0.0}
    _write_limit(wiring, access, "limit_torque", torque, checks, is_needed=True)
    # Documented for the velocity and position modes only: operation mode is held by the torque limit.
    _write_limit(wiring, access, "limit_cur", current, checks, is_needed=False)


def _write_exactly(
    wiring: Wiring, access: ParameterAccess, name: str, values: Mapping[int, float], checks: CheckList
) -> None:
    parameter = PARAMETERS[name]
    for joint, found in access.write(parameter, values).items():
        if isinstance(found, Unreadable):
            checks.problem(wiring.names[joint], f"{name} cannot be verified ({found.reason})")
        elif found != values[joint]:
            checks.problem(wiring.names[joint], f"{name} reads {found:g} after {values[joint]:g} was written")
        else:
            checks.passed(wiring.names[joint], _in_words(name, found))


def _in_words(name: str, value: float) -> str:
    if name == "canTimeout":
        return f"stops {1000.0 * CanTimeout.to_seconds(int(value)):g} ms after the last command"
    return f"{name} {value:g}"


def _write_limit(
    wiring: Wiring,
    access: ParameterAccess,
    name: str,
    values: Mapping[int, float],
    checks: CheckList,
    *,
    is_needed: bool,
) -> None:
    parameter = PARAMETERS[name]
    unit = parameter.unit
    for joint, found in access.write(parameter, values).items():
        wanted = values[joint]
        if isinstance(found, Unreadable):
            note = checks.problem if is_needed else checks.warn
            note(wiring.names[joint], f"{name} cannot be verified ({found.reason})")
        elif not found <= wanted * (1.0 + _FLOAT32):  # NaN too
            checks.problem(wiring.names[joint], f"{name} reads {found:g} {unit} after {wanted:g} was written")
        elif found < wanted * (1.0 - _FLOAT32):
            checks.warn(wiring.names[joint], f"{name} reads {found:g} {unit}: the motor allows no {wanted:g}")
        else:
            checks.passed(wiring.names[joint], f"at most {found:g} {unit}")


def read_supply(wiring: Wiring, access: ParameterAccess, sources: Sequence[str], checks: CheckList) -> None:
    """Show the supply voltage of each channel's motors."""
    found = access.read(dict.fromkeys(range(wiring.count), PARAMETERS["VBUS"]))
    for channel, source in enumerate(sources):
        volts = [v for i in wiring.on_channel(channel) if isinstance(v := found[i], float)]
        if volts:
            checks.passed(source, f"supply {min(volts):.1f} to {max(volts):.1f} V at its motors")
        else:
            checks.warn(source, "no motor tells its supply voltage")
