"""What a description's types cannot say: limits in order, lists as long as the joints, poses within limits."""

from __future__ import annotations

import math
from collections.abc import Iterator

from humanoid_sim.errors import InputError
from humanoid_sim.robots.rates import steps_per_period
from humanoid_sim.robots.schema import JointDescription, RobotDescription, StandbySettings

__all__ = ["description_problems"]

_MOTOR_IDS = range(1, 128)


def description_problems(robot: RobotDescription) -> Iterator[str]:
    """Everything that is wrong, in the order of the document, as `joints[3].upper: what is wrong`."""
    yield from _text("name", robot.name)
    yield from _text("mjcf", robot.mjcf)
    yield from _text("imu", robot.imu)
    if robot.is_floating:
        yield from _text("base.body", robot.base.body)
    if robot.base.height is not None and not math.isfinite(robot.base.height):
        yield f"base.height: is {robot.base.height}, expected a finite number"
    if not robot.joints:
        yield "joints: is empty, expected at least one joint"
    yield from _duplicates("joints", [joint.name for joint in robot.joints], "name")
    for i, joint in enumerate(robot.joints):
        yield from _joint(f"joints[{i}]", joint)
    yield from _shared_motors(robot)
    yield from _pose(robot, "initial_position", robot.initial_position)
    yield from _duplicates("hands", list(robot.hands), "entry")
    yield from _rates(robot)
    n = robot.joint_count
    for name, values, scalar in (
        ("damping_controller", robot.damping_controller.damping, robot.damping_controller.damping_scalar),
        (
            "remote_policy_controller",
            robot.remote_policy_controller.damping,
            robot.remote_policy_controller.damping_scalar,
        ),
    ):
        if values:
            yield from _gains(f"{name}.damping", values, n)
        yield from _number(f"{name}.damping_scalar", scalar)
    timeout = robot.remote_policy_controller.stale_command_timeout_ms
    yield from _number("remote_policy_controller.stale_command_timeout_ms", timeout, above_zero=True)
    yield from _standby(robot, "standby_controller_a", robot.standby_controller_a)
    yield from _standby(robot, "standby_controller_b", robot.standby_controller_b)


def _text(where: str, value: str) -> Iterator[str]:
    if not value.strip():
        yield f"{where}: is empty, expected a text"


def _number(where: str, value: float, *, above_zero: bool = False) -> Iterator[str]:
    if not math.isfinite(value) or value < 0.0 or (above_zero and value == 0.0):
        yield f"{where}: is {value}, expected a finite number {'>' if above_zero else '>='} 0"


def _duplicates(where: str, names: list[str], what: str) -> Iterator[str]:
    for i, name in enumerate(names):
        first = names.index(name)
        if first != i:
            yield f"{where}[{i}]: has the same {what} '{name}' as {where}[{first}]"


def _joint(where: str, joint: JointDescription) -> Iterator[str]:
    yield from _text(f"{where}.name", joint.name)
    for name, limit in (("lower", joint.lower), ("upper", joint.upper)):
        if not math.isfinite(limit):
            yield f"{where}.{name}: is {limit}, expected a finite number"
    if joint.lower >= joint.upper:
        yield f"{where}.upper: is {joint.upper:g}, expected more than lower, which is {joint.lower:g} ({joint.name})"
    yield from _number(f"{where}.effort_limit", joint.effort_limit, above_zero=True)
    yield from _number(f"{where}.stiffness", joint.stiffness)
    yield from _number(f"{where}.damping", joint.damping)
    if joint.motor is None:
        return
    if joint.motor.bus < 0:
        yield f"{where}.motor.bus: is {joint.motor.bus}, expected a 0-based index"
    if joint.motor.can_id not in _MOTOR_IDS:
        yield f"{where}.motor.can_id: is {joint.motor.can_id}, expected {_MOTOR_IDS[0]} to {_MOTOR_IDS[-1]}"
    yield from _text(f"{where}.motor.model", joint.motor.model)
    yield from _number(f"{where}.motor.torque_limit", joint.motor.torque_limit)
    yield from _number(f"{where}.motor.current_limit", joint.motor.current_limit)


def _shared_motors(robot: RobotDescription) -> Iterator[str]:
    """One id is one motor, over all buses: several buses may be wired to one channel."""
    owner: dict[int, int] = {}
    for i, joint in enumerate(robot.joints):
        if joint.motor is None:
            continue
        first = owner.setdefault(joint.motor.can_id, i)
        if first != i:
            taken_by = f"joints[{first}] ({robot.joints[first].name})"
            yield f"joints[{i}].motor.can_id: is {joint.motor.can_id}, which is taken by {taken_by}"


def _length(where: str, values: tuple[float, ...], n: int) -> Iterator[str]:
    if len(values) != n:
        yield f"{where}: has {len(values)} values, expected {n}, one per joint"


def _gains(where: str, values: tuple[float, ...], n: int) -> Iterator[str]:
    yield from _length(where, values, n)
    for i, value in enumerate(values):
        yield from _number(f"{where}[{i}]", value)


def _pose(robot: RobotDescription, where: str, pose: tuple[float, ...]) -> Iterator[str]:
    yield from _length(where, pose, robot.joint_count)
    for i, (joint, value) in enumerate(zip(robot.joints, pose, strict=False)):
        if not joint.lower <= value <= joint.upper:  # NaN too
            yield (
                f"{where}[{i}]: is {value:g}, outside the limits of {joint.name}, {joint.lower:g} to {joint.upper:g}"
            )


def _rates(robot: RobotDescription) -> Iterator[str]:
    simulation, hardware = robot.simulation, robot.hardware
    broken = [
        *_number("simulation.physics_timestep", simulation.physics_timestep, above_zero=True),
        *_number("simulation.control_frequency", simulation.control_frequency, above_zero=True),
    ]
    yield from broken
    if not broken:
        try:
            steps_per_period(1.0 / simulation.control_frequency, simulation.physics_timestep)
        except InputError as error:
            yield f"simulation.physics_timestep: {str(error).partition(': ')[2]}"
    if not math.isfinite(simulation.floor_height):
        yield f"simulation.floor_height: is {simulation.floor_height}, expected a finite number"
    yield from _number("hardware.control_frequency", hardware.control_frequency, above_zero=True)
    yield from _number("hardware.rx_timeout_ms", hardware.rx_timeout_ms, above_zero=True)


def _standby(robot: RobotDescription, where: str, standby: StandbySettings) -> Iterator[str]:
    yield from _gains(f"{where}.target_stiffness", standby.target_stiffness, robot.joint_count)
    yield from _gains(f"{where}.target_damping", standby.target_damping, robot.joint_count)
    if not standby.segment_durations:
        yield f"{where}.segment_durations: is empty, expected one duration per segment"
    for i, duration in enumerate(standby.segment_durations):
        yield from _number(f"{where}.segment_durations[{i}]", duration, above_zero=True)
    if len(standby.pose_segments) != len(standby.segment_durations):
        yield (
            f"{where}.pose_segments: has {len(standby.pose_segments)} poses, expected "
            f"{len(standby.segment_durations)}, one per segment duration"
        )
    for i, pose in enumerate(standby.pose_segments):
        yield from _pose(robot, f"{where}.pose_segments[{i}]", pose)
