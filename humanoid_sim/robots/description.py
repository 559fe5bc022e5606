"""Read a robot description from its YAML file; whatever is wrong is one line with file, field and what is accepted."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import math
import os
import pkgutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from humanoid_sim.assets import asset_path, shipped
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.policy_step import resolve_action
from humanoid_sim.errors import InputError, MissingPackageError, blaming, known_names, needing, reason_of, require_known
from humanoid_sim.files import is_file, regular_file
from humanoid_sim.names import near_miss
from humanoid_sim.robots.checks import description_problems
from humanoid_sim.robots.schema import DampingSettings, RobotDescription, StandbySettings
from humanoid_sim.strict_yaml import read_yaml, schema_problem

__all__ = [
    "RobotDescription",
    "load_robot",
    "shipped_robots",
    "with_contract",
    "with_contract_physics",
    "with_imu",
    "with_joint_limits",
]


def shipped_robots() -> tuple[str, ...]:
    """Names of the robots that come with the package."""
    return shipped("robots")


def load_robot(name_or_path: str | Path) -> RobotDescription:
    """Load a shipped robot's description (`lite`), a YAML file's, beside its MJCF, or one of an MJCF alone.

    `robot_descriptions:g1` is the MJCF of a public robot, of which the package robot_descriptions has many.

    A YAML's MJCF must exist; its content is checked when a simulation is built. A path that ends in `.xml` is any
    user's MJCF: `humanoid_sim.robots.mjcf` says what is read from it. A YAML without a list of joints changes single
    fields of that, as in `joints: {left_knee: {effort_limit: 60}}`, and its poses may be mappings too. Raises
    `InputError`, such as `lite.yaml: joints[3].upper: is -3, expected more than lower, …`.
    """
    path, label = robot_file(str(name_or_path))
    if path.suffix == ".urdf":
        raise InputError(
            f"{label}: is a URDF, which says neither whether the base floats nor where the IMU is; "
            f"`python -m humanoid_sim.robot convert {label} --base floating` makes an MJCF of it"
        )
    if path.suffix == ".xml":
        from humanoid_sim.robots.mjcf import describe_mjcf  # noqa: PLC0415 - MuJoCo only where there is an MJCF

        return describe_mjcf(path)
    return robot_of(read_yaml(path, label), label, path.resolve().parent)


def robot_of(document: Any, label: str, folder: Path) -> RobotDescription:
    """Return the robot of a file's document, which messages call `label`. Raises as `load_robot`."""
    if document is None:
        raise InputError(f"{label}: is empty, expected a robot description")
    if not isinstance(document, dict):
        kind = {list: "list", str: "text", bool: "boolean"}.get(type(document), "number")
        raise InputError(f"{label}: is a {kind}, expected a mapping with name, mjcf, joints, …")
    if "folder" in document:
        raise InputError(f"{label}: folder: is not a field of the file; give 'mjcf' relative to the file instead")
    # Its joints are left to the MJCF, or it changes some of them.
    partial = isinstance(document.get("joints", {}), dict) and isinstance(document.get("mjcf"), str)
    if partial:
        with blaming(label, InputError):
            document = _completed(document, folder)
    document = {**document, "folder": str(folder.resolve())}
    try:
        robot = msgspec.convert(document, RobotDescription)
    except msgspec.ValidationError as error:
        raise InputError(f"{label}: {schema_problem(error, document, RobotDescription, hidden='folder')}") from None
    for problem in description_problems(_bounded(robot) if partial else robot):
        raise InputError(f"{label}: {problem}")
    if not is_file(robot.mjcf_path):
        raise InputError(f"{label}: mjcf: '{robot.mjcf}' is not a file; it is looked up beside the description")
    return robot


def robot_file(name_or_path: str) -> tuple[Path, str]:
    """Return a robot's file, and what to call it in messages. Raises `InputError` where there is none."""
    known = shipped_robots()
    if name_or_path in known:
        return asset_path("robots", f"{name_or_path}.yaml"), f"{name_or_path}.yaml"
    if name_or_path.startswith(PREFIX):
        return public_mjcf(name_or_path), name_or_path
    path = Path(name_or_path)
    if os.path.isdir(path):
        raise InputError(
            f"{name_or_path}: is a folder, expected a robot's YAML file, an MJCF or one of: {', '.join(known)}"
        )
    if not os.path.exists(path):
        unknown = f"{known_names('robot', name_or_path, known)}, {PREFIX}NAME; or a file that exists"
        public = "" if near_miss(name_or_path, known) else public_name(name_or_path)
        raise InputError(f"{unknown}; did you mean {public}?" if public else unknown)
    return regular_file(path, "a robot's YAML file or an MJCF"), name_or_path


PREFIX = "robot_descriptions:"
"""Prefix of public robots' names: `robot_descriptions:g1` is the MJCF that the package knows as `g1`."""
_MJCF, _URDF = "_mj_description", "_description"


def public_robots() -> tuple[str, ...]:
    """Return names of the robots whose MJCF that package knows. Raises `MissingPackageError` without it."""
    return tuple(sorted(name.removesuffix(_MJCF) for name in _modules() if name.endswith(_MJCF)))


def public_name(name: str) -> str:
    """Return the public robot that was probably meant by a name without the prefix, with it; '' for none.

    Also '' where robot_descriptions is not installed: nobody knows its names then.
    """
    try:
        known = public_robots()
    except MissingPackageError:
        return ""
    parts = name.lower().replace("-", "_").split("_")
    without_vendor = ("_".join(parts[i:]) for i in range(len(parts)))
    found = next((short for short in without_vendor if short in known), "") or near_miss(name, known)
    return f"{PREFIX}{found}" if found else ""


def public_mjcf(name: str) -> Path:
    """Return the MJCF of a public robot. At its first use its repository is cloned, with progress on stderr.

    Args:
        name: with the prefix, as the user gave it.

    Raises:
        InputError: the robot is unknown, or cannot be downloaded now.
        MissingPackageError: robot_descriptions is not installed.
    """
    short = name.removeprefix(PREFIX).removesuffix(_MJCF)
    known = public_robots()
    if short not in known:
        if short + _URDF in _modules() or short in _modules():
            raise InputError(
                f"{name}: robot_descriptions has this robot as a URDF only; "
                "`python -m humanoid_sim.robot convert` makes an MJCF of one"
            )
        raise InputError(known_names("public robot", short, known))
    try:
        with contextlib.redirect_stdout(sys.stderr):
            module = importlib.import_module(f"robot_descriptions.{short}{_MJCF}")
    except Exception as error:  # of git, of the network, of the disk: whatever it is, the robot is not here
        raise InputError(
            f"{name}: could not be fetched: {reason_of(error)}; it is cloned with git at its first use, which needs a "
            "network, into ~/.cache/robot_descriptions, or into the folder that ROBOT_DESCRIPTIONS_CACHE names"
        ) from None
    return Path(module.MJCF_PATH)


def _modules() -> frozenset[str]:
    with needing("robot_descriptions", "menagerie", f"--robot {PREFIX}…"):
        import robot_descriptions  # noqa: PLC0415 - an extra
    return frozenset(module.name for module in pkgutil.iter_modules(robot_descriptions.__path__))


def with_contract(description: RobotDescription, contract: PolicyContract) -> RobotDescription:
    """Return the description with the contract's gains, standing in the contract's default pose.

    The joints' K_p and K_d, both standby poses and their gains, the initial position, and the K_d of damping and of the
    remote controller's passive hold become the contract's, and so does what `with_contract_physics` takes from it. A
    default pose beyond a joint's limit is moved to it, as the joint's stop would. Raises `InputError` if the contract's
    joints are not the robot's.
    """
    with blaming(description.name):
        gains = resolve_action(contract, description.joint_names)
        order = joint_indices(description.joint_names, contract.joint_names, "joints of the robot")
    stiffness, damping = tuple(gains.stiffness.tolist()), tuple(gains.damping.tolist())
    pose = tuple(np.clip(contract.default_joint_pos[order], description.lower, description.upper).tolist())
    replace = msgspec.structs.replace
    standby_a, standby_b = (
        StandbySettings(
            target_stiffness=stiffness,
            target_damping=damping,
            segment_durations=(sum(settings.segment_durations),),
            pose_segments=(pose,),
        )
        for settings in (description.standby_controller_a, description.standby_controller_b)
    )
    limited = with_contract_physics(description, contract)
    return replace(
        limited,
        joints=tuple(
            replace(joint, stiffness=stiffness[i], damping=damping[i]) for i, joint in enumerate(limited.joints)
        ),
        initial_position=pose,
        damping_controller=DampingSettings(damping=damping),
        standby_controller_a=standby_a,
        standby_controller_b=standby_b,
        remote_policy_controller=replace(description.remote_policy_controller, damping=damping),
    )


def with_imu(description: RobotDescription, frame: str | None) -> RobotDescription:
    """Return the description with its IMU at another site or body of its MJCF; None: as it is."""
    return description if frame is None else msgspec.structs.replace(description, imu=frame)


def with_contract_physics(description: RobotDescription, contract: PolicyContract) -> RobotDescription:
    """Return the description simulated as the contract wants it.

    With the joints' own damping or without it, and with the torque limits that the policy was trained with, as far as
    they are below the robot's own. On a floating base the following guard stays with the robot's own.
    """
    replace = msgspec.structs.replace
    if contract.model_joint_damping != "undecided":
        simulation = replace(description.simulation, joint_damping=contract.model_joint_damping)
        description = replace(description, simulation=simulation)
    if contract.effort_limit is not None:
        limits = dict(zip(contract.joint_names, contract.effort_limit.tolist(), strict=True))
        joints = tuple(
            replace(joint, effort_limit=min(joint.effort_limit, limits.get(joint.name, math.inf)))
            for joint in description.joints
        )
        following = description.guards.following
        if description.is_floating and joints != description.joints and following is not None and not following.effort:
            # Legs that were trained with less than their motors have press at that for as long as they like.
            own = following.effort_share * np.array([joint.effort_limit for joint in description.joints])
            effort = tuple(bound if math.isfinite(bound) else None for bound in own.tolist())
            guards = replace(description.guards, following=replace(following, effort=effort))
            description = replace(description, guards=guards)
        description = replace(description, joints=joints)
    return description


def with_joint_limits(contract: PolicyContract, description: RobotDescription) -> PolicyContract:
    """Return the contract whose `position_clip: joint_limits` are this robot's; any other contract as it is."""
    if not isinstance(contract.position_clip, str):
        return contract
    places = [description.joint_names.index(name) for name in contract.action_joint_names]
    ranges = np.stack([description.lower[places], description.upper[places]], axis=1)
    return dataclasses.replace(contract, position_clip=ranges)


_FAR = 1e6
"""rad, or N·m: stands for no limit where limits are compared."""
_POSE = "initial_position"


def _completed(document: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return the whole document of a robot file that gives only what differs from its MJCF, relative to `folder`.

    Raises `InputError`, without the file's name, if the MJCF cannot be read, or a joint is not in it.
    """
    from humanoid_sim.robots.mjcf import describe_mjcf  # noqa: PLC0415 - MuJoCo only where it is needed

    path = folder / document["mjcf"]
    if not is_file(path):
        raise InputError(f"mjcf: '{document['mjcf']}' is not a file; it is looked up beside the description")
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
    require_known("joint", [name], names, f"{where}: ")
    return names.index(name)


def _merged(whole: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return mappings field by field, anything else as it was changed."""
    for name, value in changes.items():
        own = whole.get(name)
        whole[name] = _merged(own, value) if isinstance(own, dict) and isinstance(value, dict) else value
    return whole


def _bounded(robot: RobotDescription) -> RobotDescription:
    """Return the robot with limits far away where its MJCF gives none, for checks of a file that may leave them out."""

    def joint_bounded(joint: Any) -> Any:
        limits = {name: getattr(joint, name) for name in ("lower", "upper", "effort_limit")}
        far = {name: math.copysign(_FAR, value) for name, value in limits.items() if math.isinf(value)}
        return msgspec.structs.replace(joint, **far)

    return msgspec.structs.replace(robot, joints=tuple(map(joint_bounded, robot.joints)))
