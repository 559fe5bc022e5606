"""A robot file of ROS 2 parameters: standby poses, gains, damping and rates as the controllers' YAML has them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import msgspec

from humanoid_sim.errors import InputError, require_known
from humanoid_sim.robots.description import load_robot, robot_of
from humanoid_sim.robots.schema import RobotDescription
from humanoid_sim.ros2.parameters import node_names, node_parameters
from humanoid_sim.strict_yaml import read_yaml

_STANDBY = ("standby_controller_a", "standby_controller_b")
_FIELDS = {
    **dict.fromkeys(_STANDBY, ("target_stiffness", "target_damping", "segment_durations")),
    "damping_controller": ("damping", "damping_scalar"),
    "remote_policy_controller": ("stale_command_policy", "stale_command_timeout_ms", "damping", "damping_scalar"),
}
"""Parameters of each controller that a robot file has under the same name."""
_PER_JOINT = ("target_stiffness", "target_damping", "damping")
_SEGMENT = "pose_segment_"
_ELSEWHERE = {
    "mode_manager": "gamepad bindings: play --gamepad FILE reads them",
    "rl_policy_controller": "the checkpoint and its contract say it",
}
"""Places where the parameters of a node belong that a robot file does not have."""


def convert_parameters(path: Path, robot: str, folder: Path) -> tuple[dict[str, Any], list[str]]:
    """Return the document of a robot file, and a line for each node with parameters that are left out.

    Raises `InputError` if there are no such parameters, they are not this robot's, or they are wrong.

    Args:
        robot: that the controllers drive: a shipped one, its YAML file, or an MJCF.
        folder: where the robot file will be, to which the MJCF's path is relative.
    """
    document, base = read_yaml(path), load_robot(robot)
    changes: dict[str, Any] = {}
    used: set[tuple[str, str]] = set()
    for node, fields in _FIELDS.items():
        values = node_parameters(document, node)
        section = {name: values[name] for name in fields if name in values}
        if not section:
            continue
        if node in _STANDBY:
            section["pose_segments"] = _segments(path, node, values)
        changes[node] = _in_order(path, node, section, values.get("joints"), base)
        used |= {(node, name) for name in values if name in section or name == "joints" or name.startswith(_SEGMENT)}
    if not changes:
        names = ", ".join(_FIELDS)
        raise InputError(f"{path}: has no parameters of {names}, expected some under '<name>: ros__parameters:'")
    rate = node_parameters(document, "controller_manager").get("update_rate")
    if rate is not None:
        changes["hardware"] = {"control_frequency": rate}
        used.add(("controller_manager", "update_rate"))
    whole = _with_changes(base, changes, folder)
    robot_of(whole, str(path), folder)
    return whole, _left_out(document, used)


def _segments(path: Path, node: str, values: dict[str, Any]) -> list[Any]:
    """Return the poses of `pose_segment_0`, `pose_segment_1`, … in order."""
    durations = values.get("segment_durations")
    count = len(durations) if isinstance(durations, list) else 0
    names = [f"{_SEGMENT}{i}" for i in range(count)]
    given = sorted(name for name in values if name.startswith(_SEGMENT))
    if not count or sorted(names) != given:
        wanted = f"{', '.join(names)}, one for each of segment_durations" if count else "segment_durations, s"
        raise InputError(f"{path}: {node}: has {', '.join(given) or 'no pose segments'}, expected {wanted}")
    return [values[name] for name in names]


def _in_order(path: Path, node: str, section: dict[str, Any], joints: Any, robot: RobotDescription) -> dict[str, Any]:
    """Return a controller's section with its lists in the order of the robot's joints."""
    if joints is None:
        joints = list(robot.joint_names)
    if not isinstance(joints, list) or len(set(map(str, joints))) != len(joints):
        raise InputError(f"{path}: {node}: joints: is {joints!r}, expected names that differ")
    require_known("joint", joints, robot.joint_names, f"{path}: {node}: joints: ")
    missing = [name for name in robot.joint_names if name not in joints]
    if missing:
        raise InputError(f"{path}: {node}: joints: lacks {', '.join(missing)} of '{robot.name}'")

    def ordered(label: str, values: Any) -> list[Any]:
        if not isinstance(values, list) or len(values) != len(joints):
            raise InputError(f"{path}: {node}: {label}: is {values!r}, expected {len(joints)} numbers, one per joint")
        return [values[joints.index(name)] for name in robot.joint_names]

    found = dict(section)
    for name in _PER_JOINT:
        if found.get(name):
            found[name] = ordered(name, found[name])
    if "pose_segments" in found:
        found["pose_segments"] = [ordered(f"{_SEGMENT}{i}", pose) for i, pose in enumerate(found["pose_segments"])]
    return found


def _with_changes(robot: RobotDescription, changes: dict[str, Any], folder: Path) -> dict[str, Any]:
    mjcf = os.path.relpath(robot.mjcf_path, folder.resolve())
    if robot.has_no_gains:  # read from its MJCF: only what differs is written
        gains = changes.get(_STANDBY[0], {})
        pairs = zip(gains.get("target_stiffness", ()), gains.get("target_damping", ()), strict=False)
        joints = {
            name: {"stiffness": stiffness, "damping": damping}
            for name, (stiffness, damping) in zip(robot.joint_names, pairs, strict=False)
        }
        return {"name": robot.name, "mjcf": mjcf, "joints": joints, **changes}
    whole: dict[str, Any] = msgspec.to_builtins(robot)
    del whole["folder"]
    merged = {name: {**whole[name], **section} for name, section in changes.items()}
    return {**whole, "mjcf": mjcf, **merged}


def _left_out(document: Any, used: set[tuple[str, str]]) -> list[str]:
    common = node_parameters(document, "")
    taken = {name for _, name in used}
    rest = [
        (node, [name for name in node_parameters(document, node) if name not in common and (node, name) not in used])
        for node in node_names(document)
    ]
    rest.insert(0, ("all nodes", [name for name in common if name not in taken]))
    return [
        f"{node}: {', '.join(names)}{f' ({_ELSEWHERE[node]})' if node in _ELSEWHERE else ''}"
        for node, names in rest
        if names
    ]
