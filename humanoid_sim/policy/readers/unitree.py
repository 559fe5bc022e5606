"""Unitree's `deploy.yaml`: everything but the names of the joints, which are given by their places on the robot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from humanoid_sim.controllers.terms import term_kind
from humanoid_sim.errors import InputError
from humanoid_sim.policy.layers import COMMAND_AXES, ROBOTS_ORDER, Layer, checked, matches
from humanoid_sim.policy.readers.mjlab import GAIT_CLOCK
from humanoid_sim.policy.readers.trainer_files import is_group, isaac_scans, joint_patterns, mapping, observation_fields
from humanoid_sim.policy.words import shown
from humanoid_sim.strict_yaml import read_yaml

DEPLOY_FILE = "deploy.yaml"


def read_deploy(path: Path, robot_joints: tuple[str, ...] | None) -> list[Layer]:
    """Return what the file states.

    Gains are listed in the robot's order, everything else in the policy's: `joint_ids_map` leads from the one to the
    other.
    """
    document = mapping(read_yaml(path), str(path))
    values: dict[str, Any] = {}
    places, unused = _places(document, str(path)), list[str]()
    for key, name in (("step_dt", "policy_dt"), ("default_joint_pos", "default_joint_pos")):
        if document.get(key) is not None:
            values[name] = document[key]
    for key in ("stiffness", "damping"):
        if document.get(key) is not None:
            name = f"joint_{key}"
            values[name] = _policy_order(checked(name, document[key], f"{path}: {key}"), places, f"{path}: {key}")
    velocity = mapping(document, str(path), "commands", "base_velocity", "ranges")
    if velocity:
        values["command_ranges"] = {axis: velocity.get(axis) for axis in COMMAND_AXES}
    if document.get("commands"):
        values["command_names"] = list(mapping(document, str(path), "commands"))
    values |= _action(document, str(path))
    group, where = mapping(document, str(path), "observations"), "observations"
    while len(group) == 1 and is_group(next(iter(group.values()))):
        name, group = next(iter(group.items()))
        where = f"{where}.{name}"
    observed = dict(observation_fields(group, f"{path}: {where}"))
    values = observed | values
    joints, origin = _joint_names(places, robot_joints, path, list(joint_patterns(document)))
    if places is not None and sorted(places) != list(range(len(places))):
        gaps = sorted(set(range(max(places))) - set(places))
        unused.append(
            f"{path.name}: joint_ids_map leaves out places {shown(gaps)}: gains are read as the policy's own, but "
            f"Unitree's program puts them on motors 0 to {len(places) - 1}, and leaves those to {max(places)} without"
        )
    assumed = {"reference_quaternion": "wxyz", **dict(isaac_scans(group, f"{path}: {where}"))}
    if any(term_kind(name).requires == "phase" for name in observed.get("observation", ())):
        assumed |= {**GAIT_CLOCK, "phase.advance_first": True}
    layers = [Layer("assumed (Unitree)", assumed, is_assumed=True)]
    if joints is not None:
        layers.append(Layer(origin, {"joint_names": joints}, is_assumed=places is None))
    return [*layers, Layer(path.name, values, unused=tuple(unused))]


def _places(document: Any, where: str) -> tuple[int, ...] | None:
    value = document.get("joint_ids_map")
    if value is None:
        return None
    found = value if isinstance(value, list) else []
    if not found or not all(type(i) is int and 0 <= i < 1000 for i in found) or len(set(found)) < len(found):
        accepted = "places on the robot, each a whole number >= 0, none twice"
        raise InputError(f"{where}: joint_ids_map is {shown(value)}, expected {accepted}")
    return tuple(found)


def _policy_order(values: Any, places: Sequence[int] | None, where: str) -> Any:
    if places is None or np.ndim(values) == 0:
        return values
    if len(values) > max(places):
        return values[list(places)]
    if len(values) == len(places):  # the robot lacks some joints of the full one, and so does the list
        return values[[sorted(places).index(place) for place in places]]
    raise InputError(
        f"{where} has {len(values)} values, expected {max(places) + 1}, as joint_ids_map, or {len(places)}"
    )


def _joint_names(
    places: Sequence[int] | None, robot_joints: tuple[str, ...] | None, path: Path, patterns: Sequence[str]
) -> tuple[tuple[str, ...] | None, str]:
    """Return the policy's joints by their places on the robot; None where no robot is known."""
    if robot_joints is None:
        return None, ""
    stranger = next(
        (text for text in patterns if not any(matches(text, joint, str(path)) for joint in robot_joints)), None
    )
    if stranger is not None:  # joints that are given by their places may be any robot's
        named = f"{path}: names '{stranger}', and no joint of this robot is called so"
        raise InputError(f"{named}: is the policy for another robot? this one has {', '.join(robot_joints)}")
    if places is None:
        return robot_joints, ROBOTS_ORDER
    if len(places) == len(robot_joints):  # also where the numbers leave gaps for joints that this robot lacks
        ranks = sorted(places)
        return tuple(robot_joints[ranks.index(place)] for place in places), f"{path.name} and the robot"
    if max(places) >= len(robot_joints):
        count = len(robot_joints)
        raise InputError(f"{path}: joint_ids_map leads to place {max(places)}, but the robot has {count} joints")
    return tuple(robot_joints[place] for place in places), f"{path.name} and the robot"


def _action(document: Any, where: str) -> dict[str, Any]:
    actions = mapping(document, where, "actions")
    if actions and tuple(actions) != ("JointPositionAction",):
        raise InputError(f"{where}: actions is {', '.join(actions)}, expected JointPositionAction alone")
    action = mapping(actions, f"{where}: actions", "JointPositionAction")
    keys = {"scale": "action_scale", "offset": "action_offset", "clip": "position_clip"}
    values = {name: action[key] for key, name in keys.items() if action.get(key) is not None}
    chosen = action.get("joint_ids")
    if chosen is None:
        chosen = action.get("joint_names")
    if chosen is not None and chosen != slice(None):
        values["action_joint_names"] = chosen
    return values
