"""Robots by name or file, and a robot as a policy's contract wants it."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import math
import os
import pkgutil
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import replace

from humanoid_sim.assets import asset_path, shipped
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.policy_step import resolve_action
from humanoid_sim.errors import InputError, blaming, known_names, needing, require_known
from humanoid_sim.robots.motors import FAMILIES, MOTORS, id_problem
from humanoid_sim.robots.schema import (
    DampingSettings,
    JointDescription,
    RobotDescription,
    StandbySettings,
    steps_per_period,
)
from humanoid_sim.strict_yaml import converted, read_yaml, require_finite

__all__ = ["RobotDescription", "load_robot", "with_contract", "with_contract_physics", "with_joint_limits"]
_PUBLIC = "robot_descriptions:"
_STANDBYS = ("standby_controller_a", "standby_controller_b")


def load_robot(name_or_path: str | Path) -> RobotDescription:
    """Load a robot: shipped (`lite`), public (`robot_descriptions:g1`), of a YAML file, or of an MJCF alone.

    A YAML file without a list of joints changes single fields of what its MJCF says, as in
    `joints: {left_knee: {effort_limit: 60}}`. Raises `InputError` with file and fields, such as
    `lite.yaml: joints[3].upper: is -3, expected more than lower, …`.
    """
    name, known = str(name_or_path), shipped("robots")
    if name in known:
        path = asset_path("robots", f"{name}.yaml")
    elif name.startswith(_PUBLIC):
        path = _public_mjcf(name)
    elif os.path.exists(name):
        path = Path(name)
    else:
        raise InputError(f"{known_names('robot', name, known)}, {_PUBLIC}NAME; or a file that exists")
    if path.suffix == ".urdf":
        convert = f"python -m humanoid_sim.robot convert {name} --base floating"
        raise InputError(f"{name}: is a URDF, expected an MJCF, as `{convert}` makes one of it")
    if path.suffix == ".xml":
        from humanoid_sim.robots.mjcf import describe_mjcf  # noqa: PLC0415 - MuJoCo only where there is an MJCF

        return describe_mjcf(path)
    if path.is_file() and path.suffix not in (".yaml", ".yml"):
        raise InputError(f"{name}: is not a robot, expected an MJCF (.xml), a URDF, or a robot's YAML file")
    document = read_yaml(path, what=f"a robot's YAML file, an MJCF or one of: {', '.join(known)}")
    with blaming(path, InputError):
        return _described(document, path.resolve().parent)


def _public_mjcf(name: str) -> Path:
    with needing("robot_descriptions", "menagerie", f"--robot {_PUBLIC}…"):
        import robot_descriptions  # noqa: PLC0415 - an extra
    end = "_mj_description"
    modules = [module.name for module in pkgutil.iter_modules(robot_descriptions.__path__)]
    short = name.removeprefix(_PUBLIC).removesuffix(end)
    known = sorted(module.removesuffix(end) for module in modules if module.endswith(end))
    if short not in known:
        near = [robot for robot in known if short.endswith(f"_{robot}")]  # `g1` of `unitree_g1`
        raise InputError(f"{name}: {known_names('public robot with an MJCF', short, near or known)}")
    # Errors are of git, of the network, of the disk; progress is no output.
    with blaming(f"{name}: could not be fetched", Exception), contextlib.redirect_stdout(sys.stderr):
        return Path(importlib.import_module(f"robot_descriptions.{short}{end}").MJCF_PATH)


def _described(document: Any, folder: Path) -> RobotDescription:
    require_finite(document)
    mjcf = document.get("mjcf") if isinstance(document, dict) else None
    if not isinstance(mjcf, str) or not os.path.isfile(folder / mjcf) or mjcf.endswith(".urdf"):
        raise InputError(f"mjcf: is {mjcf!r}, expected the name of an MJCF beside the description")
    if isinstance(document.get("joints", {}), dict):
        document = _completed(document, folder / mjcf)
    robot = converted({**document, "folder": str(folder)}, RobotDescription)
    if problems := [*_problems(robot), *_motor_problems(robot)] or [*_range_problems(robot)]:
        raise InputError("; ".join(problems))
    return robot


def _completed(changes: dict[str, Any], mjcf: Path) -> dict[str, Any]:
    """Return what an MJCF says, with changes; those of joints and of their initial positions are by name."""
    from humanoid_sim.robots.mjcf import describe_mjcf  # noqa: PLC0415 - MuJoCo only where it is needed

    described = describe_mjcf(mjcf)
    whole, names = msgspec.to_builtins(described), described.joint_names
    joints, pose = changes.get("joints", {}), changes.get("initial_position", {})
    require_known("joint", joints, names, "joints: ")
    for joint in whole["joints"]:
        fields = joints.get(joint["name"], {})
        if not isinstance(fields, dict):
            raise InputError(f"joints.{joint['name']}: is {fields!r}, expected fields, such as {{effort_limit: 60}}")
        converted({**joint, **fields}, JointDescription, f"joints.{joint['name']}")
        joint.update(fields)
    if isinstance(pose, dict):
        require_known("joint", pose, names, "initial_position: ")
        pose = [pose.get(name, own) for name, own in zip(names, described.initial_position, strict=True)]
    for standby in _STANDBYS:  # the robot's standby pose is where it starts
        whole[standby]["pose_segments"] = [pose]
    return _merged(whole, {**changes, "joints": whole["joints"], "initial_position": pose})


def _merged(whole: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    for name, value in changes.items():
        own = whole.get(name)
        whole[name] = _merged(own, value) if isinstance(own, dict) and isinstance(value, dict) else value
    return whole


def _problems(robot: RobotDescription) -> Iterator[str]:
    if robot.is_floating and not robot.base.body.strip():
        yield "base.body: is empty, expected the body with the free joint"
    if len(set(robot.joint_names)) != robot.joint_count:
        yield "joints: several have the same name"
    for i, joint in enumerate(robot.joints):
        if joint.lower >= joint.upper:
            yield f"joints[{i}].upper: is {joint.upper:g}, expected more than lower, which is {joint.lower:g}"
    try:
        steps_per_period(1.0 / robot.simulation.control_frequency, robot.simulation.physics_timestep)
    except InputError as error:
        yield f"simulation.{error}"
    poses = {"initial_position": robot.initial_position}
    lists: dict[str, Sequence[float | None] | None] = {
        "damping_controller.damping": robot.damping_controller.damping or None,
        "remote_policy_controller.damping": robot.remote_policy_controller.damping or None,
        "guards.following_effort": robot.guards.following_effort or None,
        "guards.speed": robot.guards.speed or None,
    }
    for name in _STANDBYS:
        standby = getattr(robot, name)
        lists |= {f"{name}.{field}": getattr(standby, field) for field in ("target_stiffness", "target_damping")}
        poses |= {f"{name}.pose_segments[{i}]": pose for i, pose in enumerate(standby.pose_segments)}
        count, expected = len(standby.pose_segments), len(standby.segment_durations)
        if count != expected:
            yield f"{name}.pose_segments: has {count} poses, expected {expected}, one per segment duration"
    for place, values in (poses | lists).items():
        if values is not None and len(values) != robot.joint_count:
            yield f"{place}: has {len(values)} values, expected {robot.joint_count}, one per joint"
    for place, pose in poses.items():
        for i, (joint, value) in enumerate(zip(robot.joints, pose, strict=False)):
            if not joint.lower <= value <= joint.upper:
                limits = f"{joint.lower:g} to {joint.upper:g}"
                yield f"{place}[{i}]: is {value:g}, outside the limits of {joint.name}, {limits}"


def _motor_problems(robot: RobotDescription) -> Iterator[str]:
    motors = {i: joint.motor for i, joint in enumerate(robot.joints) if joint.motor is not None}
    families = {MOTORS[motor.model].family for motor in motors.values() if motor.model in MOTORS}
    owner: dict[int, int] = {}  # one id is one motor, over all buses: several buses may be wired to one channel
    for i, motor in motors.items():
        place = f"joints[{i}].motor"
        if motor.model not in MOTORS:
            yield f"{place}.model: {known_names('motor model', motor.model, MOTORS)}"
            continue
        family = FAMILIES[MOTORS[motor.model].family]
        if motor.family not in ("", family.name):
            yield f"{place}.family: is {motor.family}, but a {motor.model} is of {family.name}"
        if problem := id_problem(family, motor.can_id, families):
            yield f"{place}.can_id: {problem}"
        if family.has_torque_limit and (motor.torque_limit is None or motor.current_limit is None):
            yield f"{place}: misses 'torque_limit' or 'current_limit'"
        first = owner.setdefault(motor.can_id, i)
        if first != i:
            yield f"{place}.can_id: is {motor.can_id}, which is the id of joints[{first}]"


def _range_problems(robot: RobotDescription) -> Iterator[str]:
    """Name what the motors would not do: their frames cut it off, while a simulation does it."""
    period, timeout = 1000.0 / robot.hardware.control_frequency, robot.hardware.rx_timeout_ms
    if timeout <= period:
        yield f"hardware.rx_timeout_ms: is {timeout:g}, expected more than the control period of {period:g} ms"
    asked = [
        ("lower", "position", np.abs(robot.lower)),
        ("upper", "position", np.abs(robot.upper)),
        ("effort_limit", "effort", robot.effort_limit),
        ("stiffness", "stiffness", robot.stiffness),
        ("damping", "damping", robot.damping),
        ("damping_controller", "damping", robot.mode_damping),
        ("remote_policy_controller", "damping", robot.passive_damping),
        *((f"{name}.target_stiffness", "stiffness", getattr(robot, name).target_stiffness) for name in _STANDBYS),
        *((f"{name}.target_damping", "damping", getattr(robot, name).target_damping) for name in _STANDBYS),
    ]
    for place, attribute, values in asked:
        beyond = []
        for joint, value in zip(robot.joints, values, strict=True):
            most = math.inf if joint.motor is None else getattr(MOTORS[joint.motor.model], attribute)
            if most < value < math.inf:
                beyond.append(f"{joint.name} ({value:g}, at most {most:g})")
        if beyond:
            degrees = "; is it in degrees?" if attribute == "position" else ""
            yield f"{place}: is more than the motor's range for {', '.join(beyond)}{degrees}"


def with_contract(description: RobotDescription, contract: PolicyContract) -> RobotDescription:
    """Return the description with the contract's gains and physics, in its default pose within the joints' limits."""
    with blaming(description.name):
        gains = resolve_action(contract, description.joint_names)
        order = joint_indices(description.joint_names, contract.joint_names, "joints of the robot")
    stiffness, damping = tuple(gains.stiffness.tolist()), tuple(gains.damping.tolist())
    pose = tuple(np.clip(contract.default_joint_pos[order], description.lower, description.upper).tolist())
    limited = with_contract_physics(description, contract)
    standbys = {
        name: StandbySettings(stiffness, damping, (sum(getattr(description, name).segment_durations),), (pose,))
        for name in _STANDBYS
    }
    gained = zip(limited.joints, stiffness, damping, strict=True)
    return replace(
        limited,
        joints=tuple(replace(joint, stiffness=k_p, damping=k_d) for joint, k_p, k_d in gained),
        initial_position=pose,
        damping_controller=DampingSettings(damping=damping),
        remote_policy_controller=replace(description.remote_policy_controller, damping=damping),
        **standbys,
    )


def with_contract_physics(description: RobotDescription, contract: PolicyContract) -> RobotDescription:
    """Return the description with the contract's joint damping, and its torque limits where they are below the robot's.

    On a floating base the following guard keeps the robot's own limits: legs trained with less may press at theirs.
    """
    if contract.model_joint_damping != "undecided":
        simulation = replace(description.simulation, joint_damping=contract.model_joint_damping)
        description = replace(description, simulation=simulation)
    if contract.effort_limit is None:
        return description
    limits = dict(zip(contract.joint_names, contract.effort_limit.tolist(), strict=True))
    joints = tuple(
        replace(joint, effort_limit=min(joint.effort_limit, limits.get(joint.name, math.inf)))
        for joint in description.joints
    )
    guards = description.guards
    if description.is_floating and joints != description.joints and guards.following and not guards.following_effort:
        own = (guards.following * description.effort_limit).tolist()
        effort = tuple(bound if math.isfinite(bound) else None for bound in own)
        guards = replace(guards, following_effort=effort)
    return replace(description, joints=joints, guards=guards)


def with_joint_limits(contract: PolicyContract, description: RobotDescription) -> PolicyContract:
    """Return the contract whose `position_clip: joint_limits` are this robot's; any other contract as it is."""
    if not isinstance(contract.position_clip, str):
        return contract
    places = [description.joint_names.index(name) for name in contract.action_joint_names]
    ranges = np.stack([description.lower[places], description.upper[places]], axis=1)
    return dataclasses.replace(contract, position_clip=ranges)
