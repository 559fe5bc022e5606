"""What is written to the motors before they are enabled, and read back: mode, limits and the CAN timeout."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from humanoid_sim.hardware.robot.checks import CheckList
from humanoid_sim.hardware.robot.requests import Requests
from humanoid_sim.hardware.robot.wiring import Wiring
from humanoid_sim.hardware.robstride.faults import FaultBit, flag_names
from humanoid_sim.hardware.robstride.messages import Command, ParameterReply, ReadParameter, Reply, WriteParameter
from humanoid_sim.hardware.robstride.parameters import (
    PARAMETERS,
    CanTimeout,
    Parameter,
    fault_word,
    pack_value,
    unpack_value,
)

__all__ = ["ParameterAccess", "check_faults", "configure", "read_supply"]

_OPERATION_MODE = 0
"""`run_mode` in which MIT commands are executed."""
_FLOAT32 = 1e-6
"""Relative; values travel as float32."""


@dataclass(frozen=True, slots=True)
class _Unreadable:
    """A motor answered that it has no such parameter, or did not answer."""

    reason: str


class ParameterAccess:
    """Reads and writes one parameter of many motors."""

    def __init__(self, requests: Requests) -> None:
        """Prepare."""
        self._requests = requests

    def read(self, parameters: Mapping[int, Parameter]) -> dict[int, float | _Unreadable]:
        """A parameter of each joint's motor."""
        return self._exchange(parameters, {})

    def write(self, parameter: Parameter, values: Mapping[int, float]) -> dict[int, float | _Unreadable]:
        """Write a value to each joint's motor and read it back; what differs is written once more."""
        parameters = dict.fromkeys(values, parameter)
        found = self._exchange(parameters, values)
        differing = {i: parameter for i, value in found.items() if not isinstance(value, float) or value != values[i]}
        return {**found, **self._exchange(differing, values)}

    def _exchange(
        self, parameters: Mapping[int, Parameter], values: Mapping[int, float]
    ) -> dict[int, float | _Unreadable]:
        def value(joint: int, reply: Reply) -> float | _Unreadable | None:
            if not isinstance(reply, ParameterReply) or reply.index != parameters[joint].index:
                return None
            if not reply.is_success:
                return _Unreadable("refused")
            return float(unpack_value(parameters[joint].type, reply.payload))

        questions: dict[int, Sequence[Command]] = {}
        host_id = self._requests.host_id
        for joint, parameter in parameters.items():
            motor_id = self._requests.wiring.motor_id[joint]
            read = ReadParameter(motor_id, parameter.index, host_id=host_id)
            if joint in values:
                payload = pack_value(parameter.type, values[joint])
                questions[joint] = [WriteParameter(motor_id, parameter.index, payload, host_id=host_id), read]
            else:
                questions[joint] = [read]
        answers: dict[int, float | _Unreadable] = self._requests.ask(questions, value)
        silent = _Unreadable("no answer")
        return {joint: answers.get(joint, silent) for joint in parameters}


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
        if isinstance(found, _Unreadable):
            checks.problem(wiring.names[joint], f"{name} cannot be verified ({found.reason})")
        elif found != values[joint]:
            checks.problem(wiring.names[joint], f"{name} reads {found:g} after {values[joint]:g} was written")
        else:
            checks.passed(wiring.names[joint], f"{name} {found:g}{_meaning(name, found)}")


def _meaning(name: str, value: float) -> str:
    if name == "canTimeout":
        return f", stops {1000.0 * CanTimeout.to_seconds(int(value)):g} ms after the last command"
    return ", MIT commands" if name == "run_mode" else ""


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
        if isinstance(found, _Unreadable):
            note = checks.problem if is_needed else checks.warn
            note(wiring.names[joint], f"{name} cannot be verified ({found.reason})")
        elif not found <= wanted * (1.0 + _FLOAT32):  # NaN too
            checks.problem(wiring.names[joint], f"{name} reads {found:g} {unit} after {wanted:g} was written")
        elif found < wanted * (1.0 - _FLOAT32):
            checks.warn(wiring.names[joint], f"{name} reads {found:g} {unit}: the motor allows no {wanted:g}")
        else:
            checks.passed(wiring.names[joint], f"{name} {found:g} {unit}")


def check_faults(wiring: Wiring, access: ParameterAccess, checks: CheckList) -> None:
    """Read the motors' fault words, which show what no status does: overvoltage."""
    for joint, found in access.read({i: fault_word(model.name) for i, model in enumerate(wiring.model)}).items():
        if isinstance(found, _Unreadable):
            checks.warn(wiring.names[joint], f"fault word cannot be read ({found.reason})")
        elif found:
            names = ", ".join(flag_names(FaultBit(int(found))))
            checks.problem(wiring.names[joint], f"reports {names} also after its faults were cleared")


def read_supply(wiring: Wiring, access: ParameterAccess, sources: Sequence[str], checks: CheckList) -> None:
    """Show the supply voltage of each channel's motors."""
    found = access.read(dict.fromkeys(range(wiring.count), PARAMETERS["VBUS"]))
    for channel, source in enumerate(sources):
        volts = [v for i in wiring.on_channel(channel) if isinstance(v := found[i], float)]
        if volts:
            checks.passed(source, f"supply {min(volts):.1f} to {max(volts):.1f} V at its motors")
        else:
            checks.warn(source, "no motor tells its supply voltage")
