"""Which motor drives which joint, on which channel, and how its frame maps to the joint's. Data and two transforms."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.motors import MOTORS, MotorModel
from humanoid_sim.robots.schema import RobotDescription

__all__ = ["Wiring", "make_wiring"]


@dataclass(frozen=True, slots=True, eq=False)
class Wiring:
    """Per-joint constants, in the robot's joint order. Every array is read-only, shape (n,)."""

    names: tuple[str, ...]
    channel: tuple[int, ...]
    """Index into the robot's channels."""
    motor_id: tuple[int, ...]
    model_name: tuple[str, ...]
    model: tuple[MotorModel, ...]
    torque_limit: tuple[float, ...]
    """N·m, written to the firmware; 0: leave the firmware's own."""
    current_limit: tuple[float, ...]
    """A, written to the firmware; 0: leave the firmware's own."""
    direction: FloatArray
    """±1"""
    offset: FloatArray
    """rad, motor frame, homing offset."""
    lower: FloatArray
    """rad, joint frame."""
    upper: FloatArray
    """rad, joint frame."""
    effort_limit: FloatArray
    """N·m, within what the motor's frames can say."""
    fastest: FloatArray
    """rad/s, the end of the motor's velocity range."""

    @property
    def count(self) -> int:
        """n, the number of joints."""
        return len(self.names)

    def on_channel(self, channel: int) -> tuple[int, ...]:
        """Indices of the joints whose motors are on a channel."""
        return tuple(i for i, index in enumerate(self.channel) if index == channel)


def make_wiring(description: RobotDescription, channel_count: int, calibration: Mapping[str, float]) -> Wiring:
    """The wiring of a robot over one channel that carries all motors, or over one channel per bus of the robot.

    Args:
        description: the robot; each of its joints needs a motor.
        channel_count: how many channels there are.
        calibration: homing offset by joint, rad, motor frame.

    Raises:
        InputError: a joint has no motor or a motor of no known model, the channels do not fit the robot's buses, or the
            calibration lacks a joint, has one too many, or holds a value that is not finite.
    """
    name = description.name
    motors = []
    for joint in description.joints:
        if joint.motor is None:
            without = ", ".join(joint.name for joint in description.joints if joint.motor is None)
            raise InputError(f"{name}: these joints have no motor in the robot description: {without}")
        if joint.motor.model not in MOTORS:
            problem = known_names("motor model", joint.motor.model, sorted(MOTORS))
            raise InputError(f"{name}: joint '{joint.name}': {problem}")
        motors.append(joint.motor)
    buses = max(motor.bus for motor in motors) + 1
    if channel_count not in {1, buses}:
        accepted = "1" if buses == 1 else f"1, which carries all motors, or {buses}, one per bus of the robot"
        raise InputError(f"{name}: {channel_count} channels given, expected {accepted}")
    models = tuple(MOTORS[motor.model] for motor in motors)
    return Wiring(
        names=description.joint_names,
        channel=tuple(motor.bus if channel_count > 1 else 0 for motor in motors),
        motor_id=tuple(motor.can_id for motor in motors),
        model_name=tuple(motor.model for motor in motors),
        model=models,
        torque_limit=tuple(motor.torque_limit for motor in motors),
        current_limit=tuple(motor.current_limit for motor in motors),
        direction=_array([motor.direction for motor in motors]),
        offset=_array(_offsets(name, description.joint_names, calibration)),
        lower=description.lower,
        upper=description.upper,
        effort_limit=_array(
            [min(joint.effort_limit, model.effort) for joint, model in zip(description.joints, models, strict=True)]
        ),
        fastest=_array([model.velocity for model in models]),
    )


def _offsets(robot: str, joints: Sequence[str], calibration: Mapping[str, float]) -> list[float]:
    missing = [joint for joint in joints if joint not in calibration]
    if missing:
        raise InputError(f"{robot}: the calibration lacks {', '.join(missing)}")
    strange = [joint for joint in calibration if joint not in joints]
    if strange:
        raise InputError(f"{robot}: the calibration has joints that the robot has not: {', '.join(strange)}")
    for joint in joints:
        if not math.isfinite(calibration[joint]):
            raise InputError(f"{robot}: the calibration's homing offset of {joint} is {calibration[joint]}")
    return [float(calibration[joint]) for joint in joints]


def _array(values: Sequence[float]) -> FloatArray:
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array
