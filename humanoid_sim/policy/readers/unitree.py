"""Unitree's `deploy.yaml`: everything but the names of the joints, which are given by their places on the robot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from humanoid_sim.controllers.terms import term_kind
from humanoid_sim.errors import InputError
from humanoid_sim.policy.findings import shown
from humanoid_sim.policy.layers import COMMAND_AXES, ROBOTS_ORDER, Layer, checked
from humanoid_sim.policy.readers.mjlab import GAIT_CLOCK
from humanoid_sim.policy.readers.trainer_files import Section, is_group, isaac_scans, observation_fields, read_section

_ACTION = {"scale": "action_scale", "offset": "action_offset", "clip": "position_clip"}


def read_deploy(path: Path, robot_joints: tuple[str, ...] | None) -> list[Layer]:
    """Return what the file states.

    Gains are listed in the robot's order, everything else in the policy's: `joint_ids_map` leads from the one to the
    other.
    """
    file = read_section(path)
    group = file["observations"]
    while len(group.values) == 1 and is_group(next(iter(group.values.values()))):
        group = group[next(iter(group.values))]
    values = observation_fields(group)
    values |= file.fields({"step_dt": "policy_dt", "default_joint_pos": "default_joint_pos"})
    places = _places(file)
    for key in ("stiffness", "damping"):
        if file.get(key) is not None:
            gains = checked(f"joint_{key}", file.get(key), f"{path}: {key}")
            if places and np.ndim(gains):
                gains = gains[_order(places, len(gains), f"{path}: {key} has {len(gains)} values")]
            values[f"joint_{key}"] = gains
    ranges = file["commands"]["base_velocity"]["ranges"]
    if ranges.values:
        values["command_ranges"] = [ranges.get(axis) for axis in COMMAND_AXES]
    if file.get("commands"):
        values["command_names"] = list(file["commands"].values)
    actions = file["actions"]
    if actions.values and list(actions.values) != ["JointPositionAction"]:
        raise InputError(f"{actions.where} is {', '.join(actions.values)}, expected JointPositionAction alone")
    action = actions["JointPositionAction"]
    values |= action.fields(_ACTION)
    driven = action.get("joint_names") if action.get("joint_ids") is None else action.get("joint_ids")
    if driven not in (None, slice(None)):
        values["action_joint_names"] = driven
    assumed = {"reference_quaternion": "wxyz", **isaac_scans(group)}
    if any(term_kind(name).requires == "phase" for name in values.get("observation", ())):
        assumed |= {**GAIT_CLOCK, "phase.advance_first": True}
    layers = [Layer("assumed (Unitree)", assumed)]
    if robot_joints is not None:
        what = f"{path}: joint_ids_map is for another robot: this one has {len(robot_joints)} joints"
        order = _order(places, len(robot_joints), what) if places else range(len(robot_joints))
        source = f"{path.name} and the robot" if places else ROBOTS_ORDER
        layers.append(Layer(source, {"joint_names": [robot_joints[i] for i in order]}))
    unused, gaps = [], sorted(set(range(max(places, default=0))) - set(places))
    if gaps:
        what = "gains are read as the policy's own, but Unitree's program puts them on motors 0 to"
        rest = f"{len(places) - 1}, and leaves those to {max(places)} without"
        unused.append(f"{path.name}: joint_ids_map leaves out places {shown(gaps)}: {what} {rest}")
    return [*layers, Layer(path.name, values, unused=tuple(unused))]


def _places(file: Section) -> list[int]:
    """Return the place on the robot of each of the policy's joints; empty where the file gives none."""
    value = file.get("joint_ids_map")
    if value is None:
        return []
    found = value if isinstance(value, list) else []
    if not found or not all(type(i) is int and 0 <= i < 1000 for i in found) or len(set(found)) < len(found):
        raise InputError(f"{file.where}: joint_ids_map is {shown(value)}, expected places on the robot, none twice")
    return found


def _order(places: Sequence[int], count: int, what: str) -> list[int]:
    """Return the index of each of the policy's joints in a list of the robot's, which may lack those of gaps."""
    if count == len(places):
        return [sorted(places).index(place) for place in places]
    if count > max(places):
        return list(places)
    raise InputError(f"{what}, expected {max(places) + 1}, as joint_ids_map, or {len(places)}")
