"""Checks of a description beyond its types: accepted values, lists as long as the joints, poses in limits."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache
from typing import get_args, get_type_hints

import msgspec

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.robots.motors import FAMILIES, MOTORS, id_problem
from humanoid_sim.robots.piano import KEY_COUNT
from humanoid_sim.robots.rates import steps_per_period
from humanoid_sim.robots.schema import Accepted, MotorDescription, RobotDescription, StandbySettings

_TOPIC_PREFIX = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def description_problems(robot: RobotDescription) -> Iterator[str]:
    """Yield everything that is wrong, as `joints[3].upper: what is wrong`: single values before what they make."""
    refused = list(refused_values(robot))
    yield from refused
    if refused:
        return
    if robot.topic_prefix and not _TOPIC_PREFIX.fullmatch(robot.topic_prefix):
        yield f"topic_prefix: is '{robot.topic_prefix}', expected letters, digits and _, a letter first"
    if robot.is_floating and not robot.base.body.strip():
        yield "base.body: is empty, expected a text"
    yield from _of_joints(robot)
    yield from _pose(robot, "initial_position", robot.initial_position)
    yield from _duplicates("hands", list(robot.hands), "entry")
    try:
        steps_per_period(1.0 / robot.simulation.control_frequency, robot.simulation.physics_timestep)
    except InputError as error:
        yield f"simulation.physics_timestep: {str(error).partition(': ')[2]}"
    for name in ("damping_controller", "remote_policy_controller"):
        values = getattr(robot, name).damping
        if values:
            yield from _length(f"{name}.damping", values, robot.joint_count)
    yield from _piano(robot)
    following, speed = robot.guards.following, robot.guards.speed
    if following is not None and following.effort:
        yield from _length("guards.following.effort", following.effort, robot.joint_count)
    if speed is not None and speed.limit:
        yield from _length("guards.speed.limit", speed.limit, robot.joint_count)
    for name in ("standby_controller_a", "standby_controller_b"):
        yield from _standby(robot, name, getattr(robot, name))


def _piano(robot: RobotDescription) -> Iterator[str]:
    piano = robot.piano
    if piano is None:
        return
    if len(piano.fingers) != 2:
        yield f"piano.fingers: has {len(piano.fingers)} sites, expected 2, the left hand's first"
    if len(piano.reach) != len(piano.fingers):
        yield f"piano.reach: has {len(piano.reach)} spans, expected one for each of the piano's fingers"
    for i, (low, high) in enumerate(piano.reach):
        if not 0 <= low <= high < KEY_COUNT:
            expected = f"the lowest and the highest key of 0 to {KEY_COUNT - 1}"
            yield f"piano.reach[{i}]: is {[low, high]}, expected {expected}"


def refused_values(struct: msgspec.Struct, prefix: str = "") -> Iterator[str]:
    """Yield what the `Accepted` of a schema refuse, in the order of the document, with the place of each."""
    for name, accepted in _accepted(type(struct)).items():
        value = getattr(struct, name)
        if isinstance(value, Mapping):
            items = {f"{prefix}{name}.{key}": item for key, item in value.items()}
        elif isinstance(value, tuple):
            items = {f"{prefix}{name}[{i}]": item for i, item in enumerate(value)}
        else:
            items = {f"{prefix}{name}": value}
        for where, item in items.items():
            if isinstance(item, msgspec.Struct):
                yield from refused_values(item, f"{where}.")
            elif accepted is not None and item is not None and accepted.problem(item):
                yield f"{where}: {accepted.problem(item)}"


@cache
def _accepted(kind: type[msgspec.Struct]) -> dict[str, Accepted | None]:
    """Return what each field of a schema accepts: of `Positive`, `Positive | None` and `tuple[Positive, ...]` alike."""
    found: dict[str, Accepted | None] = {}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        marks = [mark for part in (hint, *get_args(hint)) for mark in getattr(part, "__metadata__", ())]
        found[name] = next((mark for mark in marks if isinstance(mark, Accepted)), None)
    return found


def _duplicates(where: str, names: list[str], what: str) -> Iterator[str]:
    for i, name in enumerate(names):
        first = names.index(name)
        if first != i:
            yield f"{where}[{i}]: has the same {what} '{name}' as {where}[{first}]"


def _of_joints(robot: RobotDescription) -> Iterator[str]:
    if not robot.joints:
        yield "joints: is empty, expected at least one joint"
    yield from _duplicates("joints", [joint.name for joint in robot.joints], "name")
    families = {joint.motor.family for joint in robot.joints if joint.motor is not None} & set(FAMILIES)
    owner: dict[int, int] = {}  # one id is one motor, over all buses: several buses may be wired to one channel
    for i, joint in enumerate(robot.joints):
        where = f"joints[{i}]"
        if joint.lower >= joint.upper:
            expected = f"more than lower, which is {joint.lower:g} ({joint.name})"
            yield f"{where}.upper: is {joint.upper:g}, expected {expected}"
        motor = joint.motor
        if motor is None:
            continue
        if motor.bus < 0:
            yield f"{where}.motor.bus: is {motor.bus}, expected a 0-based index"
        yield from _of_family(motor, f"{where}.motor", families)
        first = owner.setdefault(motor.can_id, i)
        if first != i:
            taken_by = f"joints[{first}] ({robot.joints[first].name})"
            yield f"{where}.motor.can_id: is {motor.can_id}, which is taken by {taken_by}"


def _of_family(motor: MotorDescription, where: str, families: set[str]) -> Iterator[str]:
    """Yield what does not fit the motor's family, or the others of the robot."""
    family = FAMILIES.get(motor.family)
    if family is None:
        yield f"{where}.family: {known_names('family', motor.family, FAMILIES)}"
        return
    model = MOTORS.get(motor.model)  # one that nobody knows is the adapter's to refuse
    if model is not None and model.family != family.name:
        yield f"{where}.family: is {family.name}, but a {motor.model} is of {model.family}"
        return
    if problem := id_problem(family, motor.can_id, families):
        yield f"{where}.can_id: {problem}"
    for name in ("torque_limit", "current_limit"):
        if family.has_torque_limit and getattr(motor, name) is None:
            yield f"{where}: misses '{name}'"
        elif not family.has_torque_limit and (value := getattr(motor, name)):
            yield f"{where}.{name}: is {value:g}, but no such limit of {family.name} motors is known; leave it out"


def _length(where: str, values: tuple[float | None, ...], n: int) -> Iterator[str]:
    if len(values) != n:
        yield f"{where}: has {len(values)} values, expected {n}, one per joint"


def _pose(robot: RobotDescription, where: str, pose: tuple[float, ...]) -> Iterator[str]:
    yield from _length(where, pose, robot.joint_count)
    for i, (joint, value) in enumerate(zip(robot.joints, pose, strict=False)):
        if not joint.lower <= value <= joint.upper:  # NaN too
            yield (
                f"{where}[{i}]: is {value:g}, outside the limits of {joint.name}, {joint.lower:g} to {joint.upper:g}"
            )


def _standby(robot: RobotDescription, where: str, standby: StandbySettings) -> Iterator[str]:
    yield from _length(f"{where}.target_stiffness", standby.target_stiffness, robot.joint_count)
    yield from _length(f"{where}.target_damping", standby.target_damping, robot.joint_count)
    if not standby.segment_durations:
        yield f"{where}.segment_durations: is empty, expected one duration per segment"
    if len(standby.pose_segments) != len(standby.segment_durations):
        yield (
            f"{where}.pose_segments: has {len(standby.pose_segments)} poses, expected "
            f"{len(standby.segment_durations)}, one per segment duration"
        )
    for i, pose in enumerate(standby.pose_segments):
        yield from _pose(robot, f"{where}.pose_segments[{i}]", pose)
