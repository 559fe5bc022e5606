"""A Lite's motors on emulated buses and a host that speaks to them in messages, at times of its choosing."""

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from humanoid_sim.hardware.emulation.emulator import Arrival, Emulator
from humanoid_sim.hardware.emulation.faults import Fault
from humanoid_sim.hardware.emulation.settings import EmulationSettings
from humanoid_sim.hardware.robstride.codec import decode_reply, encode_command
from humanoid_sim.hardware.robstride.messages import Command, Enable, OperationControl, Reply, Status
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.robots.motors import MOTORS

LITE: RobotDescription = load_robot("lite")
_MOTORS = [joint.motor for joint in LITE.joints if joint.motor is not None]
IDS = [motor.can_id for motor in _MOTORS]
MODELS_BY_ID = {motor.can_id: MOTORS[motor.model] for motor in _MOTORS}
_HOST = 0xFD


class Bench:
    """Everything that arrives is kept in `log`."""

    def __init__(self, buses: int = 1, settings: EmulationSettings | None = None, faults: Sequence[Fault] = ()) -> None:
        self.emulator = Emulator(LITE, buses, settings=settings, faults=faults)
        self.log: list[Arrival] = []

    def arrivals(self, make: Callable[[int], Command], duration: float) -> list[Arrival]:
        """Tell every motor something at once, wait, and give what came."""
        for motor_id in IDS:
            self.submit(make(motor_id))
        arrived = self.emulator.advance(self.emulator.time + duration)
        self.log += arrived
        return arrived

    def submit(self, command: Command) -> None:
        bus = _MOTORS[IDS.index(command.motor_id)].bus if self.emulator.bus_count > 1 else 0
        frame = encode_command(command, MODELS_BY_ID[command.motor_id])
        self.emulator.submit(bus, frame, self.emulator.time)

    def tell(self, command: Command) -> list[Reply]:
        self.submit(command)
        return self.advance(0.002)

    def ask(self, make: Callable[[int], Command]) -> list[Reply]:
        return self._read(self.arrivals(make, 0.01))

    def advance(self, duration: float) -> list[Reply]:
        arrived = self.emulator.advance(self.emulator.time + duration)
        self.log += arrived
        return self._read(arrived)

    def enable(self) -> None:
        modes = [reply.mode.name for reply in self.ask(Enable) if isinstance(reply, Status)]
        assert modes == ["RUN"] * len(IDS)

    def command(self, *, duration: float, effort: float = 0.0, damping: float = 0.0) -> list[Status]:
        """The same MIT command to every motor, and the statuses that came of it."""
        replies = self._read(
            self.arrivals(lambda motor_id: OperationControl(motor_id, 0.0, 0.0, effort, 0.0, damping), duration)
        )
        return [reply for reply in replies if isinstance(reply, Status)]

    def torque(self) -> np.ndarray:
        return self.emulator.motors.plant.truth(0.0).joint_effort

    def turn(self, motor: int) -> float:
        """rad, by which a motor's own zero is away from the joint's, after power-on: whole turns."""
        return round(-self.emulator.motors.states[motor].origin / (2 * math.pi)) * 2 * math.pi

    @staticmethod
    def _read(arrivals: Iterable[Arrival]) -> list[Reply]:
        replies = []
        for arrival in arrivals:
            reply = decode_reply(arrival.frame, MODELS_BY_ID, _HOST)
            if isinstance(reply, Reply):
                replies.append(reply)
        return replies
