"""Checks of a robot description between its fields: lengths of lists, poses within limits, motors and their ids."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.robots.motors import FAMILIES, MOTORS, id_problem
from humanoid_sim.robots.rates import steps_per_period
from humanoid_sim.robots.schema import MotorDescription, RobotDescription


def description_problems(robot: RobotDescription) -> Iterator[str]:
    """Yield everything that is wrong, as `joints[3].upper: what is wrong`."""
    if robot.is_floating and not robot.base.body.strip():
        yield "base.body: is empty, expected the body with the free joint"
    for i, joint in enumerate(robot.joints):
        first = robot.joint_names.index(joint.name)
        if first != i:
            yield f"joints[{i}]: has the same name '{joint.name}' as joints[{first}]"
        if joint.lower >= joint.upper:
            yield f"joints[{i}].upper: is {joint.upper:g}, expected more than lower, which is {joint.lower:g}"
    try:
        steps_per_period(1.0 / robot.simulation.control_frequency, robot.simulation.physics_timestep)
    except InputError as error:
        yield f"simulation.{error}"
    yield from _motor_problems({i: joint.motor for i, joint in enumerate(robot.joints) if joint.motor is not None})
    for name in ("standby_controller_a", "standby_controller_b"):
        standby = getattr(robot, name)
        yield from _length_problem(robot, f"{name}.target_stiffness", standby.target_stiffness)
        yield from _length_problem(robot, f"{name}.target_damping", standby.target_damping)
        count, expected = len(standby.pose_segments), len(standby.segment_durations)
        if count != expected:
            yield f"{name}.pose_segments: has {count} poses, expected {expected}, one per segment duration"
        for i, pose in enumerate(standby.pose_segments):
            yield from _pose_problems(robot, f"{name}.pose_segments[{i}]", pose)
    yield from _pose_problems(robot, "initial_position", robot.initial_position)
    for name, values in {  # these may be left out
        "damping_controller.damping": robot.damping_controller.damping,
        "remote_policy_controller.damping": robot.remote_policy_controller.damping,
        "guards.following_effort": robot.guards.following_effort,
        "guards.speed": robot.guards.speed,
    }.items():
        if values:
            yield from _length_problem(robot, name, values)


def _length_problem(robot: RobotDescription, place: str, values: Sequence[float | None]) -> Iterator[str]:
    if len(values) != robot.joint_count:
        yield f"{place}: has {len(values)} values, expected {robot.joint_count}, one per joint"


def _pose_problems(robot: RobotDescription, place: str, pose: Sequence[float]) -> Iterator[str]:
    yield from _length_problem(robot, place, pose)
    for i, (joint, value) in enumerate(zip(robot.joints, pose, strict=False)):
        if joint.lower < joint.upper and not joint.lower <= value <= joint.upper:
            yield f"{place}[{i}]: is {value:g}, outside the limits of {joint.name}, {joint.lower:g} to {joint.upper:g}"


def _motor_problems(motors: dict[int, MotorDescription]) -> Iterator[str]:
    families = {MOTORS[motor.model].family for motor in motors.values() if motor.model in MOTORS}
    owner: dict[int, int] = {}  # one id is one motor, over all buses: several buses may be wired to one channel
    for i, motor in motors.items():
        if motor.model not in MOTORS:
            yield f"joints[{i}].motor.model: {known_names('motor model', motor.model, MOTORS)}"
            continue
        family = FAMILIES[MOTORS[motor.model].family]
        if motor.family not in ("", family.name):
            yield f"joints[{i}].motor.family: is {motor.family}, but a {motor.model} is of {family.name}"
        if problem := id_problem(family, motor.can_id, families):
            yield f"joints[{i}].motor.can_id: {problem}"
        if family.has_torque_limit and (motor.torque_limit is None or motor.current_limit is None):
            yield f"joints[{i}].motor: misses 'torque_limit' or 'current_limit'"
        first = owner.setdefault(motor.can_id, i)
        if first != i:
            yield f"joints[{i}].motor.can_id: is {motor.can_id}, which is the id of joints[{first}]"
