"""Robot files that give an MJCF and only what differs from it: the rest is read from there.

    mjcf: scene.xml
    imu: torso_imu
    joints:
      left_knee: {effort_limit: 60}

Such a file has no list of joints. Its `joints`, and its poses, may be mappings from the names of joints.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.files import is_file
from humanoid_sim.robots.schema import RobotDescription

_FAR = 1e6
"""rad, or N·m: stands for no limit where limits are compared."""
_POSE = "initial_position"


def is_partial(document: Mapping[str, Any]) -> bool:
    """Whether a robot file leaves its joints to the MJCF, or changes some of them."""
    return isinstance(document.get("joints", {}), dict) and isinstance(document.get("mjcf"), str)


def completed(document: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The whole document of a robot file that gives only what differs from its MJCF.

    Args:
        document: the file's.
        folder: that its MJCF is relative to.

    Raises:
        InputError: without the file's name: the MJCF cannot be read, or a joint is not in it.
    """
    from humanoid_sim.robots.mjcf import describe_mjcf  # noqa: PLC0415 - MuJoCo only where it is needed

    path = folder / document["mjcf"]
    if not is_file(path):
        raise InputError(f"mjcf: '{document['mjcf']}' is no file; it is looked up beside the description")
    described = describe_mjcf(path)
    whole: dict[str, Any] = msgspec.to_builtins(described)
    del whole["folder"]
    names = described.joint_names
    changes = dict(document)
    by_joint = changes.pop("joints", {})
    for name, fields in by_joint.items():
        joint = whole["joints"][_place("joints", name, names)]
        if not isinstance(fields, dict):
            raise InputError(f"joints.{name}: is {fields!r}, expected a mapping, such as {{effort_limit: 60}}")
        if "name" in fields:
            raise InputError(f"joints.{name}.name: is given twice, expected it as the key alone")
        joint.update(fields)
    if isinstance(changes.get(_POSE), dict):
        pose = list(whole[_POSE])
        for name, value in changes[_POSE].items():
            pose[_place(_POSE, name, names)] = value
        changes[_POSE] = pose
    if _POSE in changes:  # a robot stands where it starts
        for standby in ("standby_controller_a", "standby_controller_b"):
            whole[standby]["pose_segments"] = [changes[_POSE]]
    return _merged(whole, changes)


def _place(where: str, name: Any, names: tuple[str, ...]) -> int:
    if name not in names:
        raise InputError(f"{where}: {known_names('joint', str(name), names)}")
    return names.index(name)


def _merged(whole: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Mappings field by field, anything else as it was changed."""
    for name, value in changes.items():
        own = whole.get(name)
        whole[name] = _merged(own, value) if isinstance(own, dict) and isinstance(value, dict) else value
    return whole


def bounded(robot: RobotDescription) -> RobotDescription:
    """The robot with limits far away where its MJCF gives none, for checks of a file that does not have to give any."""

    def joint_bounded(joint: Any) -> Any:
        limits = {name: getattr(joint, name) for name in ("lower", "upper", "effort_limit")}
        far = {name: math.copysign(_FAR, value) for name, value in limits.items() if math.isinf(value)}
        return msgspec.structs.replace(joint, **far)

    return msgspec.structs.replace(robot, joints=tuple(map(joint_bounded, robot.joints)))
