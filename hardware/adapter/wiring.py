"""Settings of an adapter, checked: channels, times, which motor drives which joint, and how frames map to joints."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.hardware.bus.address import BusAddress, parse_address
from humanoid_sim.hardware.motors import MotorGroup
from humanoid_sim.hardware.robstride.codec import LARGEST_MOTOR_ID
from humanoid_sim.hardware.robstride.parameters import CanTimeout
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.motors import FAMILIES, MOTORS
from humanoid_sim.robots.schema import RobotDescription


@dataclass(frozen=True, slots=True, eq=False)
class Wiring(MotorGroup):
    """A robot's motors, in its joint order, with what maps their frames to the joints'. Every array is read-only."""

    direction: FloatArray
    """Shape (n,), ±1."""
    offset: FloatArray
    """Shape (n,), rad, motor frame, homing offset."""
    lower: FloatArray
    """Shape (n,), rad, joint frame."""
    upper: FloatArray
    """Shape (n,), rad, joint frame."""
    effort_limit: FloatArray
    """Shape (n,), N·m, within what the motor's frames can say."""
    fastest: FloatArray
    """Shape (n,), rad/s, the end of the motor's velocity range; infinite where nobody knows how fast it can turn."""
    position_range: FloatArray
    """Shape (n,), rad, motor frame, the end of what its frames can say of a position, beyond which a report wraps."""

    @property
    def endless(self) -> tuple[int, ...]:
        """Joints whose motors execute their last command for ever when their host falls silent."""
        return tuple(i for i, model in enumerate(self.model) if not FAMILIES[model.family].has_timeout)


def make_wiring(
    description: RobotDescription, channel_count: int, calibration: Mapping[str, float] | None = None
) -> Wiring:
    """Return the wiring of a robot over one channel that carries all motors, or over one channel per bus of the robot.

    Raises `InputError` if a joint has no motor or a motor of no known model, the channels do not fit the robot's buses,
    or the calibration lacks a joint, has one too many, or holds a value that is not finite.

    Args:
        calibration: homing offset by joint, rad, motor frame; None: 0 for all, where the joints' angles do not matter.
    """
    name = description.name
    offsets = dict.fromkeys(description.joint_names, 0.0) if calibration is None else calibration
    motors = []
    for joint in description.joints:
        if joint.motor is None:
            without = ", ".join(joint.name for joint in description.joints if joint.motor is None)
            raise InputError(f"{name}: these joints have no motor in the robot description: {without}")
        if joint.motor.model not in MOTORS:
            problem = known_names("motor model", joint.motor.model, MOTORS)
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
        model=models,
        torque_limit=tuple(motor.torque_limit or 0.0 for motor in motors),
        current_limit=tuple(motor.current_limit or 0.0 for motor in motors),
        direction=_array([motor.direction for motor in motors]),
        offset=_array(_offsets(name, description.joint_names, offsets)),
        lower=description.lower,
        upper=description.upper,
        effort_limit=_array(
            [min(joint.effort_limit, model.effort) for joint, model in zip(description.joints, models, strict=True)]
        ),
        fastest=_array([max(model.velocity, model.no_load_velocity) for model in models]),
        position_range=_array([model.position for model in models]),
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


@dataclass(frozen=True, slots=True, eq=False)
class AdapterSettings:
    """All that stays the same between two activations."""

    name: str
    addresses: tuple[BusAddress, ...]
    wiring: Wiring
    host_id: int
    control_period: float
    """s between two commands."""
    can_timeout: float
    """s without a command after which a motor stops by itself."""
    rx_timeout: float
    """s without a status after which a joint counts as silent."""
    damping: FloatArray
    """Shape (n,), N·m·s/rad, of the command that stands in for a bad one and that closing sends."""

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of the channels' safety statuses: the family of the motors there, then the channel."""
        families: list[dict[str, None]] = [{} for _ in self.addresses]
        for channel, model in zip(self.wiring.channel, self.wiring.model, strict=True):
            families[channel][model.family] = None
        return tuple(
            f"humanoid_devices_{'_'.join(names)}/{address}"
            for names, address in zip(families, self.addresses, strict=True)
        )


def make_settings(
    description: RobotDescription,
    channels: Sequence[BusAddress | str],
    calibration: Mapping[str, float],
    *,
    control_period: float | None,
    host_id: int,
    can_timeout: float,
    allow_no_timeout: bool,
) -> AdapterSettings:
    """Return settings for a robot; arguments and errors are those of `HardwareRobot`."""
    name = description.name
    addresses = tuple(parse_address(channel) if isinstance(channel, str) else channel for channel in channels)
    if len(set(addresses)) < len(addresses):
        raise InputError(f"{name}: a channel is named twice; one channel carries all motors by itself")
    if not LARGEST_MOTOR_ID < host_id <= 0xFF:
        raise InputError(f"host id: is {host_id}, expected {LARGEST_MOTOR_ID + 1} to 255, above every motor's")
    period = 1.0 / description.hardware.control_frequency if control_period is None else control_period
    longest = CanTimeout.to_seconds(CanTimeout.LONGEST)
    if not period < can_timeout <= longest:
        raise InputError(
            f"CAN timeout: is {can_timeout:g} s, expected more than the control period of {period:g} s, and at most "
            f"{longest:g} s: motors without a timeout execute their last command for ever"
        )
    wiring = make_wiring(description, len(addresses), calibration)
    endless = ", ".join(wiring.names[i] for i in wiring.endless)
    if endless and not allow_no_timeout:
        raise InputError(
            f"{description.name}: motors that execute their last command for ever when this program or its computer "
            f"dies, for no timeout of theirs is known: {endless}; --allow-no-timeout accepts that"
        )
    return AdapterSettings(
        name=name,
        addresses=addresses,
        wiring=wiring,
        host_id=host_id,
        control_period=period,
        can_timeout=can_timeout,
        rx_timeout=description.hardware.rx_timeout_ms / 1000.0,
        damping=description.mode_damping,
    )
