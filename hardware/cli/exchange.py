"""Questions that several tools ask: parameters, versions, statuses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.cli.client import MotorClient
from humanoid_sim.hardware.robstride.firmware import FirmwareVersion
from humanoid_sim.hardware.robstride.messages import (
    DeviceId,
    GetDeviceId,
    ParameterReply,
    ReadParameter,
    ReadVersion,
    Reply,
    Status,
    Version,
    WriteParameter,
)
from humanoid_sim.hardware.robstride.parameters import CanTimeout, Parameter, pack_value, unpack_value

__all__ = [
    "any_status",
    "poll_values",
    "read_device_id",
    "read_value",
    "read_values",
    "read_version",
    "shown",
    "write_value",
]


def read_device_id(client: MotorClient, motor_id: int) -> DeviceId:
    """Who a motor is.

    Raises:
        SilentMotorError: it does not answer.
    """
    question = GetDeviceId(motor_id, host_id=client.host_id)
    return client.require(question, lambda reply: reply if isinstance(reply, DeviceId) else None)


def read_version(client: MotorClient, motor_id: int) -> FirmwareVersion | None:
    """A motor's firmware; none if it does not know the question, which it then takes for a stop."""
    question = ReadVersion(motor_id, host_id=client.host_id)
    return client.ask(question, lambda reply: reply.version if isinstance(reply, Version) else None)


def read_value(client: MotorClient, motor_id: int, parameter: Parameter) -> float | None:
    """A parameter's value; none if the motor has no such parameter.

    Raises:
        SilentMotorError: the motor does not answer.
    """
    question = ReadParameter(motor_id, parameter.index, host_id=client.host_id)
    reply = client.require(question, lambda reply: _of(reply, parameter))
    return unpack_value(parameter.type, reply.payload) if reply.is_success else None


def read_values(client: MotorClient, motor_ids: Sequence[int], parameter: Parameter, wait: float) -> dict[int, float]:
    """A parameter of several motors, asked once; those that did not answer or have none are left out."""
    questions = _questions(client, motor_ids, parameter)
    return _values(client.ask_each(questions, lambda reply: _of(reply, parameter), wait=wait, attempts=1), parameter)


def poll_values(client: MotorClient, motor_ids: Sequence[int], parameter: Parameter, wait: float) -> dict[int, float]:
    """`read_values` for what is read again and again: a late answer counts the next time."""
    questions = _questions(client, motor_ids, parameter)
    return _values(client.poll(questions, lambda reply: _of(reply, parameter), wait=wait), parameter)


def _questions(client: MotorClient, motor_ids: Sequence[int], parameter: Parameter) -> dict[int, ReadParameter]:
    return {motor_id: ReadParameter(motor_id, parameter.index, host_id=client.host_id) for motor_id in motor_ids}


def _values(replies: Mapping[int, ParameterReply], parameter: Parameter) -> dict[int, float]:
    return {
        motor_id: unpack_value(parameter.type, reply.payload) for motor_id, reply in replies.items() if reply.is_success
    }


def _of(reply: Reply, parameter: Parameter) -> ParameterReply | None:
    return reply if isinstance(reply, ParameterReply) and reply.index == parameter.index else None


def write_value(client: MotorClient, motor_id: int, parameter: Parameter, value: float) -> Status:
    """Write a parameter and verify it; the status that the motor answered with.

    Raises:
        FieldError: the value does not fit the parameter's type.
        SilentMotorError: the motor does not answer.
        RobotError: it reads back differently.
    """
    payload = pack_value(parameter.type, value)
    status = client.require(WriteParameter(motor_id, parameter.index, payload, host_id=client.host_id), any_status)
    found = read_value(client, motor_id, parameter)
    if found is None or pack_value(parameter.type, found) != payload:
        shown = "nothing" if found is None else f"{found:g}"
        raise RobotError(
            f"motor {motor_id} on {client.address}: {parameter.name} reads {shown} after {value:g} was written"
        )
    return status


def shown(parameter: Parameter, value: float | None) -> str:
    """A value for a person."""
    if value is None:
        return "not there"
    if parameter.name == "canTimeout":
        return f"{value} ({1000.0 * CanTimeout.to_seconds(int(value)):g} ms)" if value else f"{value} (off)"
    return f"{value:g} {parameter.unit}".rstrip() if parameter.type.is_float else str(value)


def any_status(reply: Reply) -> Status | None:
    """Accepts any status."""
    return reply if isinstance(reply, Status) else None
