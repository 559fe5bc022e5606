"""Checks of a robot description between its fields: lengths of lists, poses within limits, motors of their family."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.robots.motors import FAMILIES, MOTORS, id_problem
from humanoid_sim.robots.rates import steps_per_period
from humanoid_sim.robots.schema import MotorDescription, RobotDescription


def description_problems(robot: RobotDescription) -> Iterator[str]:
    """Yield everything that is wrong, as `joints[3].upper: what is wrong`."""
    if not re.fullmatch("([A-Za-z][A-Za-z0-9_]*)?", robot.topic_prefix):
        yield f"topic_prefix: is '{robot.topic_prefix}', expected letters, digits and _, a letter first"
    if robot.is_floating and not robot.base.body:
        yield "base.body: is empty, expected the body with the free joint"
    names, ids = set[str](), set[int]()  # one id is one motor: several buses may be wired to one channel
    families = {joint.motor.family for joint in robot.joints if joint.motor is not None} & set(FAMILIES)
    for i, joint in enumerate(robot.joints):
        if joint.name in names:
            yield f"joints[{i}].name: is '{joint.name}' again"
        if joint.lower >= joint.upper:
            yield f"joints[{i}].upper: is {joint.upper:g}, expected more than lower, {joint.lower:g} ({joint.name})"
        if joint.motor is not None:
            yield from (f"joints[{i}].motor{problem}" for problem in _motor_problems(joint.motor, families))
            if joint.motor.can_id in ids:
                yield f"joints[{i}].motor.can_id: is {joint.motor.can_id} again"
            ids.add(joint.motor.can_id)
        names.add(joint.name)
    try:
        steps_per_period(1.0 / robot.simulation.control_frequency, robot.simulation.physics_timestep)
    except InputError as error:
        yield f"simulation.{error}"
    yield from _list_problems(robot)


def _motor_problems(motor: MotorDescription, families: set[str]) -> Iterator[str]:
    """Yield what does not fit the motor's family, or the others of the robot."""
    family, model = FAMILIES.get(motor.family), MOTORS.get(motor.model)
    if family is None:
        yield f".family: {known_names('family', motor.family, FAMILIES)}"
        return
    if model is not None and model.family != family.name:  # the adapter refuses a model that does not exist
        yield f".family: is {family.name}, but a {motor.model} is of {model.family}"
        return
    if problem := id_problem(family, motor.can_id, families):
        yield f".can_id: {problem}"
    for name in ("torque_limit", "current_limit"):
        value = getattr(motor, name)
        if family.has_torque_limit and value is None:
            yield f": misses '{name}'"
        elif not family.has_torque_limit and value:
            yield f".{name}: is {value:g}, but no such limit of {family.name} motors is known; leave it out"


def _list_problems(robot: RobotDescription) -> Iterator[str]:
    """Yield lists that are not as long as the joints, and poses beyond limits."""
    following, speed = robot.guards.following, robot.guards.speed
    lists: dict[str, Sequence[object]] = {  # empty: a default
        "damping_controller.damping": robot.damping_controller.damping,
        "remote_policy_controller.damping": robot.remote_policy_controller.damping,
        "guards.following.effort": following.effort if following else (),
        "guards.speed.limit": speed.limit if speed else (),
    }
    lists = {place: values for place, values in lists.items() if values}
    poses = {"initial_position": robot.initial_position}
    standbys = {"standby_controller_a": robot.standby_controller_a, "standby_controller_b": robot.standby_controller_b}
    for name, standby in standbys.items():
        lists[f"{name}.target_stiffness"] = standby.target_stiffness
        lists[f"{name}.target_damping"] = standby.target_damping
        poses |= {f"{name}.pose_segments[{i}]": pose for i, pose in enumerate(standby.pose_segments)}
        count, expected = len(standby.pose_segments), len(standby.segment_durations)
        if count != expected:
            yield f"{name}.pose_segments: has {count} poses, expected {expected}, one per segment duration"
    for place, values in {**lists, **poses}.items():
        if len(values) != robot.joint_count:
            yield f"{place}: has {len(values)} values, expected {robot.joint_count}, one per joint"
    for place, pose in poses.items():
        for i, (joint, value) in enumerate(zip(robot.joints, pose, strict=False)):
            if not joint.lower <= value <= joint.upper:
                yield f"{place}[{i}]: is {value:g}, expected {joint.lower:g} to {joint.upper:g} ({joint.name})"
