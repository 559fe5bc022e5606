"""Unitree's `deploy.yaml`: everything but the names of the joints, which are given by their places on the robot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import msgspec

from humanoid_sim.controllers.terms import term_kind
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.policy.findings import shown
from humanoid_sim.policy.layers import COMMAND_AXES, Layer
from humanoid_sim.policy.readers.mjlab import GAIT_CLOCK
from humanoid_sim.policy.readers.trainer_files import is_group, observation_fields, read_section

_ACTION = {"scale": "action_scale", "offset": "action_offset", "clip": "position_clip"}


def read_deploy(path: Path, robot_joints: tuple[str, ...] | None) -> list[Layer]:
    """Return what the file states: gains in the robot's order, to which `joint_ids_map` leads from the policy's."""
    file = read_section(path)
    group = file.at("observations")
    while len(group) == 1 and is_group(next(iter(group.values()))):
        group = group.at(*group)
    values, unused = observation_fields(group)
    values |= file.fields({"step_dt": "policy_dt", "default_joint_pos": "default_joint_pos"})
    with blaming(f"{path}: joint_ids_map", msgspec.ValidationError):
        places = msgspec.convert(file.get("joint_ids_map") or [], list[Annotated[int, msgspec.Meta(ge=0)]])
    for key in ("stiffness", "damping"):
        gains = file.get(key)
        if places and isinstance(gains, list):
            gains = [gains[i] for i in _order(places, len(gains), f"{path}: {key} has {len(gains)} values")]
        if gains is not None:
            values[f"joint_{key}"] = gains
    if ranges := file.at("commands", "base_velocity", "ranges"):
        values["command_ranges"] = [ranges.get(axis) for axis in COMMAND_AXES]
    if commands := file.at("commands"):
        values["command_names"] = list(commands)
    actions = file.at("actions")
    if actions and list(actions) != ["JointPositionAction"]:
        raise InputError(f"{actions.where} is {', '.join(actions)}, expected JointPositionAction alone")
    action = actions.at("JointPositionAction")
    values |= action.fields(_ACTION)
    driven = action.get("joint_names") if action.get("joint_ids") is None else action["joint_ids"]
    if driven not in (None, slice(None)):
        values["action_joint_names"] = driven
    assumed: dict[str, Any] = {}
    kinds = [term_kind(name) for name in values.get("observation", ())]
    if any(kind.task == "tracking" for kind in kinds):
        assumed["reference_quaternion"] = "wxyz"
    if any(kind.requires == "phase" for kind in kinds):
        assumed |= {**GAIT_CLOCK, "phase.advance_first": True}
    layers = [Layer("assumed (Unitree)", assumed)]
    if robot_joints is not None and places:
        what = f"{path}: joint_ids_map is for another robot: this one has {len(robot_joints)} joints"
        order = _order(places, len(robot_joints), what)
        layers.append(Layer(f"{path.name} and the robot", {"joint_names": [robot_joints[i] for i in order]}))
    if gaps := sorted(set(range(max(places, default=0))) - set(places)):
        what = "gains are read as the policy's own, but Unitree's program puts them on motors 0 to"
        rest = f"{len(places) - 1}, and leaves those to {max(places)} without"
        unused += (f"{path.name}: joint_ids_map leaves out places {shown(gaps)}: {what} {rest}",)
    return [*layers, Layer(path.name, values, unused=unused)]


def _order(places: Sequence[int], count: int, what: str) -> list[int]:
    """Return the index of each of the policy's joints in a list of the robot's, which may lack those of gaps."""
    if count == len(places):
        return [sorted(places).index(place) for place in places]
    if count > max(places):
        return list(places)
    raise InputError(f"{what}, expected {max(places) + 1}, as joint_ids_map, or {len(places)}")
