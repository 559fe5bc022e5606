"""Read and write parameters of many motors at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from humanoid_sim.hardware.robot.requests import Requests
from humanoid_sim.hardware.robstride.messages import Command, ParameterReply, ReadParameter, Reply, WriteParameter
from humanoid_sim.hardware.robstride.parameters import Parameter, pack_value, unpack_value

__all__ = ["ParameterAccess", "Unreadable"]


_WRITES = 4
"""Times that a value is written before what is read back counts."""


@dataclass(frozen=True, slots=True)
class Unreadable:
    """A motor answered that it has no such parameter, or did not answer."""

    reason: str


class ParameterAccess:
    """Reads and writes one parameter of many motors."""

    def __init__(self, requests: Requests) -> None:
        """Prepare."""
        self._requests = requests

    def read(self, parameters: Mapping[int, Parameter]) -> dict[int, float | Unreadable]:
        """A parameter of each joint's motor."""
        return self._exchange(parameters, {})

    def write(self, parameter: Parameter, values: Mapping[int, float]) -> dict[int, float | Unreadable]:
        """Write a value to each joint's motor and read it back; what differs is written again: its frame was lost."""
        found: dict[int, float | Unreadable] = {}
        differing = dict.fromkeys(values, parameter)
        for _ in range(_WRITES):
            found |= self._exchange(differing, values)
            differing = {i: parameter for i, value in found.items() if isinstance(value, float) and value != values[i]}
        return found

    def _exchange(
        self, parameters: Mapping[int, Parameter], values: Mapping[int, float]
    ) -> dict[int, float | Unreadable]:
        def value(joint: int, reply: Reply) -> float | Unreadable | None:
            if not isinstance(reply, ParameterReply) or reply.index != parameters[joint].index:
                return None
            if not reply.is_success:
                return Unreadable("refused")
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
        answers: dict[int, float | Unreadable] = self._requests.ask(questions, value)
        silent = Unreadable("no answer")
        return {joint: answers.get(joint, silent) for joint in parameters}
