"""Two motors on the wire, and the robot that they make."""

import contextlib
import errno
import itertools
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Self

import can
from can.interfaces.virtual import VirtualBus
from motor_surface import Loop, make_robot, mit_command, short_waits
from wire_motor import ENABLE, SET_ZERO, WRITE, Frame, Operation, WireBus, WireMotor

from humanoid_sim.errors import RobotError
from humanoid_sim.messages import Intent, SafetyStatus, TickOutput
from humanoid_sim.mit import MITState

PERIOD = 0.02
"""s, control period of the robot below."""
LEFT_AT, RIGHT_AT = -0.25, 0.5
"""rad, joint frame, where the joints are."""
HOMING_OFFSETS = {"left": 0.4, "right": -0.3}
"""rad, motor frame: motor = direction * joint + offset."""

_numbers = itertools.count()


def until(condition: Callable[[], Any], what: str = "it never came", seconds: float = 10.0) -> Any:
    """Return what a condition gives as soon as it holds."""
    deadline = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < deadline, what
        time.sleep(0.0005)
    return found


def robot_document(**changes: Any) -> dict[str, Any]:
    """Return a robot file's document: `left` is an rs-02 that turns against its joint, `right` an rs-00."""
    gains = {"stiffness": 50.0, "damping": 2.0}
    motors = (
        {"bus": 0, "can_id": 11, "model": "rs-02", "direction": -1, "torque_limit": 12.0, "current_limit": 16.0},
        {"bus": 1, "can_id": 21, "model": "rs-00", "direction": 1, "torque_limit": 10.0, "current_limit": 0.0},
    )
    limits = ({"lower": -1.5, "upper": 1.0, "effort_limit": 12.0}, {"lower": -0.5, "upper": 2.0, "effort_limit": 10.0})
    pose = {
        "target_stiffness": [50.0, 50.0],
        "target_damping": [2.0, 2.0],
        "segment_durations": [0.2],
        "pose_segments": [[LEFT_AT, RIGHT_AT]],
    }
    return {
        "name": "pair",
        "mjcf": "pair.xml",
        "imu": "imu",
        "joints": [
            {"name": name, **limit, **gains, "motor": motor}
            for name, limit, motor in zip(("left", "right"), limits, motors, strict=True)
        ],
        "initial_position": [LEFT_AT, RIGHT_AT],
        "damping_controller": {"damping_scalar": 3.0},
        "standby_controller_a": pose,
        "standby_controller_b": pose,
        **changes,
    }


def write_calibration(path: Path, **offsets: float) -> Path:
    """Write a calibration as it stands in the files of today."""
    motors = {"left": (11, -1), "right": (21, 1)}
    offsets = HOMING_OFFSETS | offsets
    path.write_text(
        "".join(
            f"{joint}:\n  id: {number}\n  direction: {direction}\n  homing_offset: {offsets[joint]}\n"
            for joint, (number, direction) in motors.items()
        )
    )
    return path


class Pair:
    """The motors `left` (11) and `right` (21), powered, each on a channel of its own, or both on one."""

    def __init__(self, folder: Path, monkeypatch: Any, *, one_channel: bool = False) -> None:
        self.monkeypatch, self.folder = monkeypatch, folder
        self.left = WireMotor(11, position=-LEFT_AT + HOMING_OFFSETS["left"])
        self.right = WireMotor(
            21, "rs-00", uid=b"motor 21", version=bytes((0, 0, 3, 6)), position=RIGHT_AT + HOMING_OFFSETS["right"]
        )
        self.motors = (self.left, self.right)
        self.log: list[Frame] = []
        self.now = 0.0
        """s, the robot's clock: it stands still unless a test moves it."""
        number = next(_numbers)
        groups = [self.motors] if one_channel else [(self.left,), (self.right,)]
        self.names = [f"survive-{number}-{i}" for i in range(len(groups))]
        self.channels = [f"virtual:{name}" for name in self.names]
        self.buses = [WireBus(name, motors, self.log) for name, motors in zip(self.names, groups, strict=True)]
        self._robots: list[Any] = []
        self.waits()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.waits()
        for motor in self.motors:
            motor.obey()
        for robot in self._robots:
            with contextlib.suppress(RobotError):
                robot.close()
        for bus in self.buses:
            bus.close()

    def waits(self, *, answers: float = 0.3, listening: float = 0.005) -> None:
        """Set the product's waits; `answers` may be short where a motor will not answer."""
        short_waits(self.monkeypatch, answers=answers, listening=listening)

    def robot(self, document: dict[str, Any] | None = None, calibration: Path | None = None, **options: Any) -> Any:
        """Return the robot of these motors; it is closed at the end of the test."""
        path = calibration or write_calibration(self.folder / "calibration.yaml")
        robot = make_robot(document or robot_document(), self.channels, path, lambda: self.now, **options)
        self._robots.append(robot)
        return robot

    def active(self, **options: Any) -> Any:
        """Return the robot, activated; the log begins afterwards."""
        robot = self.robot(**options)
        robot.activate()
        self.now += 1.0
        self.answered(robot)
        self.log.clear()
        return robot

    def sent(self, motor: WireMotor, *kinds: int) -> list[Frame]:
        """Return the frames of some types that the product has sent to a motor."""
        return [f for f in list(self.log) if f.motor == motor.motor_id and f.kind in kinds and not f.is_reply]

    def commands(self, motor: WireMotor) -> list[Operation]:
        """Return the operation control that a motor has received."""
        return [f.operation for f in list(self.log) if f.motor == motor.motor_id and f.operation is not None]

    @property
    def touched(self) -> list[Frame]:
        """Frames that change something in a motor, but for stops."""
        return [f for f in list(self.log) if f.kind in (ENABLE, SET_ZERO, WRITE) and not f.is_reply]

    def answered(self, robot: Any, *, asks: bool = True) -> tuple[MITState, tuple[SafetyStatus, ...]]:
        """Return state and statuses as soon as every motor that speaks has been heard in this period.

        Where it has not, a limp command asks for an answer.
        """

        def fresh() -> Any:
            state, statuses = robot.read()
            speaks = [not motor.is_silent for motor in self.motors]
            return all(state.joint_age[speaks] < 0.5 * PERIOD) and (state, statuses)

        if asks and not fresh():
            self.command(robot, hold(stiffness=0.0, damping=0.0))
        return until(fresh, "a motor does not answer its commands")

    def command(self, robot: Any, command: Any) -> None:
        """Write a command, and wait until it has come to every motor."""
        before = [len(self.commands(motor)) for motor in self.motors]
        robot.write(command)
        for motor, count in zip(self.motors, before, strict=True):
            until(lambda motor=motor, count=count: len(self.commands(motor)) > count, "a command does not leave")

    @contextlib.contextmanager
    def jammed(self, number: int = errno.ENOBUFS, channel: int = 0) -> Iterator[list[int]]:
        """Let the product's sending on a channel fail, but for as many frames as it yields `[permits]`."""
        permits = [0]
        real, name = VirtualBus.send, self.names[channel]

        def send(bus: VirtualBus, message: can.Message, timeout: float | None = None) -> None:
            if bus.channel_id == name:
                if permits[0] == 0:
                    raise can.CanOperationError("Failed to transmit", error_code=number)
                permits[0] -= 1
            real(bus, message, timeout)

        with self.monkeypatch.context() as patch:
            patch.setattr(VirtualBus, "send", send)
            yield permits


class Run:
    """A loop of `read`, `step` and `write` on the robot's own clock."""

    def __init__(self, pair: Pair, robot: Any) -> None:
        self.pair, self.robot = pair, robot
        self._loop = Loop(robot_document())

    def tick(self, *intents: Intent) -> tuple[TickOutput, tuple[SafetyStatus, ...]]:
        self.pair.now += PERIOD
        state, statuses = self.robot.read()
        output = self._loop.step(state, statuses, *intents)
        self.pair.command(self.robot, output.command)
        self.pair.answered(self.robot, asks=False)
        return output, statuses

    def stand(self) -> TickOutput:
        """Walk up to STANDBY, in which both joints are held with stiffness."""
        self.tick(Intent.DAMP)
        self.tick(Intent.LOAD_A)
        for _ in range(12):
            output, _ = self.tick()
        assert output.command.stiffness.min() > 10.0, output.control_mode
        return output


def hold(left: float = LEFT_AT, right: float = RIGHT_AT, stiffness: float = 50.0, damping: float = 2.0) -> Any:
    return mit_command([left, right], stiffness, damping)


def at_motor(joint: str, angle: float) -> float:
    """Return a joint's angle, rad, in its motor's frame."""
    return HOMING_OFFSETS[joint] + (-angle if joint == "left" else angle)


def wrapped(angle: float) -> float:
    """Return an angle, rad, as a motor counts it at power-on: 0 to one turn."""
    return angle % (2.0 * math.pi)
