"""Mock motors without a clock: one by itself, and a Lite's on their buses with a host that speaks in messages."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from humanoid_sim.hardware.can_bus import Frame
from humanoid_sim.hardware.mock.motors import Arrival, MockMotors
from humanoid_sim.hardware.mock.robstride_motor import RobstrideMotor
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, pack_value, unpack_value
from humanoid_sim.hardware.robstride.protocol import (
    FrameType,
    OperationControl,
    ParameterReply,
    Reply,
    Status,
    decode_reply,
    encode_command,
    encode_operation,
    parameter_data,
)
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.motors import MOTORS

ID = 11
HOST = 0xFD
LITE = load_robot("lite")
_MOTORS = [joint.motor for joint in LITE.joints if joint.motor is not None]
IDS = [motor.can_id for motor in _MOTORS]
MODELS = {motor.can_id: MOTORS[motor.model] for motor in _MOTORS}


def robstride(shaft: float = 0.0) -> RobstrideMotor:
    motor = RobstrideMotor(MOTORS["rs-02"], ID, bytes(range(8)))
    motor.sensed.shaft = shaft
    motor.power_on()
    return motor


@dataclass
class Lone:
    """An rs-02 whose sensors the test sets, and that answers in messages."""

    motor: RobstrideMotor = field(default_factory=robstride)
    time: float = 0.0

    def tell(self, kind: FrameType, data: bytes = b"") -> list[Reply]:
        return self._read(self.motor.receive(encode_command(kind, self.motor.can_id, data), self.time))

    def wait(self, duration: float) -> list[Reply]:
        """Let the motor look after itself every ms."""
        replies = []
        for _ in range(round(duration / 0.001)):
            self.time += 0.001
            replies += self._read(self.motor.advance(self.time))
        return replies

    def status(self, kind: FrameType, data: bytes = b"") -> Status:
        (reply,) = self.tell(kind, data)
        assert isinstance(reply, Status)
        return reply

    def mit(self, position: float = 0.0, stiffness: float = 0.0, effort: float = 0.0) -> Status:
        command = OperationControl(position, 0.0, effort, stiffness, 0.0)
        (reply,) = self._read(self.motor.receive(encode_operation(ID, command, self.motor.model), self.time))
        assert isinstance(reply, Status)
        return reply

    def write(self, name: str, value: float) -> Status:
        parameter = PARAMETERS[name]
        data = parameter_data(parameter.index, pack_value(parameter.type, value))
        return self.status(FrameType.WRITE_PARAMETER, data)

    def read(self, name: str) -> float:
        parameter = PARAMETERS[name]
        (reply,) = self.tell(FrameType.READ_PARAMETER, parameter_data(parameter.index))
        assert isinstance(reply, ParameterReply)
        assert reply.is_success
        return unpack_value(parameter.type, reply.payload)

    def _read(self, frames) -> list[Reply]:
        models = dict.fromkeys(range(1, 128), self.motor.model)
        replies = [decode_reply(frame, models, self.motor.host_id) for frame in frames]
        assert all(isinstance(reply, Reply) for reply in replies)
        return replies


class Bench:
    """The motors of a Lite; all that arrives is kept in `log`."""

    def __init__(self, buses: int = 1) -> None:
        self.mock = MockMotors(LITE, buses)
        self.log: list[Arrival] = []

    def submit(self, frame: Frame) -> None:
        bus = _MOTORS[IDS.index(frame.arbitration_id & 0xFF)].bus if len(set(self.mock.bus_of)) > 1 else 0
        self.mock.submit(bus, frame, self.mock.time)

    def advance(self, duration: float) -> list[Reply]:
        arrived = self.mock.advance(self.mock.time + duration)
        self.log += arrived
        return [reply for reply in self._read(arrived) if isinstance(reply, Reply)]

    def ask(self, make: Callable[[int], Frame], duration: float = 0.01) -> list[Reply]:
        for motor_id in IDS:
            self.submit(make(motor_id))
        return self.advance(duration)

    def enable(self) -> None:
        modes = [
            reply.mode.name
            for reply in self.ask(partial(encode_command, FrameType.ENABLE))
            if isinstance(reply, Status)
        ]
        assert modes == ["RUN"] * len(IDS)

    def command(self, *, duration: float, effort: float = 0.0) -> list[Status]:
        """Command every motor the same; returns the statuses that came back."""
        command = OperationControl(0.0, 0.0, effort, 0.0, 0.0)
        replies = self.ask(lambda motor_id: encode_operation(motor_id, command, MODELS[motor_id]), duration)
        return [reply for reply in replies if isinstance(reply, Status)]

    def torque(self) -> np.ndarray:
        return self.mock.plant.truth(0.0).joint_effort

    def turn(self, motor: int) -> float:
        """rad, whole turns by which a motor's own zero is away from the joint's after power-on."""
        return round(-self.mock.motors[motor].origin / (2 * math.pi)) * 2 * math.pi

    @staticmethod
    def _read(arrivals: Iterable[Arrival]):
        return [decode_reply(arrival.frame, MODELS, HOST) for arrival in arrivals]
