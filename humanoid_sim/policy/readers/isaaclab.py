"""`params/env.yaml` of a training: Isaac Lab's `ManagerBasedRLEnvCfg`, or mjlab's, without the order of the joints."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from humanoid_sim.errors import InputError, blaming
from humanoid_sim.policy.layers import COMMAND_AXES, MALFORMED, Layer
from humanoid_sim.policy.readers.trainer_files import Section, chosen_joints, is_group, observation_fields, read_section

_GAINS = {"stiffness": "joint_stiffness", "damping": "joint_damping", "effort_limit": "effort_limit"}
_MOTION = {"anchor_body_name": "anchor_body", "body_names": "body_names"}
_ACTION = {"scale": "action_scale", "clip": "position_clip"}


class _OtherActionError(InputError):
    """The policy's actions are no joint positions: nothing else that is stated helps."""


def read_env(path: Path, _: object) -> list[Layer]:
    """Return gains, pose, scale, terms and rate, or that they cannot be read: the file may hold what only it needs."""
    try:
        with blaming(path, MALFORMED):
            return _layers(path)
    except _OtherActionError:
        raise
    except InputError as error:
        return [Layer(path.name, {}, unused=(f"{path.name} cannot be read: {error}",))]


def _layers(path: Path) -> list[Layer]:
    file = read_section(path)
    values: dict[str, Any] = {}
    unused: tuple[str, ...] = ()
    physics, key = (file.at("sim"), "dt") if "dt" in file.at("sim") else (file.at("sim", "mujoco"), "timestep")
    if physics.get(key) is not None and file.get("decimation") is not None:
        values["policy_dt"] = physics.number(key) * file.number("decimation")
    robot = file.at("scene", "robot") or file.at("scene", "entities", "robot")  # Isaac Lab's, or mjlab's
    if pose := robot.at("init_state", "joint_pos"):
        values["default_joint_pos"] = {".*": 0.0, **pose}
    listed = robot.at("articulation").get("actuators") or []
    actuators = robot.at("actuators") or Section(dict(enumerate(listed)), f"{path}: actuators")
    for name in actuators:
        kind = str(actuators.at(name).get("class_type") or "").rpartition(":")[2]
        if kind.startswith("ActuatorNet"):
            raise InputError(f"actuators {name} are {kind}, a network that is not reproduced here")
        if kind.startswith("Delayed") or actuators.at(name).get("delay_max_lag"):
            unused += (f"{path.name}: actuators {name} are delayed, which is not read",)
    for key, name in _GAINS.items():
        gains: dict[str, Any] = {}
        for actuator in actuators:
            gains |= _by_pattern(actuators.at(actuator), key)
        if gains:
            values[name] = gains
    values |= _action(file.at("actions"))
    for name in ("policy", "actor"):  # Isaac Lab's name of the policy's group, and mjlab's, whose terms lie one deeper
        group = file.at("observations", name)
        if is_group(group):
            terms = group.at("terms")
            observed, remarks = observation_fields(Section({**group, **terms, "terms": None}, group.where))
            values, unused = values | observed, (*unused, *remarks)
    groups = () if "observation" in values else file.at("observations")
    unused += tuple(f"{path.name}: observations of {name} are not read, expected policy or actor" for name in groups)
    values |= file.at("commands", "motion").fields(_MOTION)
    velocity = file.at("commands", "base_velocity")
    ranges = velocity.at("limit_ranges") or velocity.at("ranges")  # Unitree's curriculum ends at limits
    if all(axis in ranges for axis in COMMAND_AXES):
        values["command_ranges"] = [ranges[axis] for axis in COMMAND_AXES]
    return [Layer(path.name, values, unused=unused)]


def _by_pattern(group: Section, key: str) -> dict[str, Any]:
    value = group.get(key) if group.get(f"{key}_sim") is None else group[f"{key}_sim"]
    patterns = group.get("joint_names_expr") or group.get("target_names_expr") or []
    if isinstance(value, dict):
        return {f"(?=(?:{pattern})$){name}": item for pattern in patterns for name, item in value.items()}
    return {} if value is None else dict.fromkeys(patterns, value)


def _action(actions: Section) -> dict[str, Any]:
    names = [name for name, term in actions.items() if isinstance(term, dict) and term.get("scale") is not None]
    if not names:
        return {}
    if len(names) > 1:
        raise InputError(f"{actions.where} are {', '.join(names)}, expected one, of joint positions")
    action = actions.at(names[0])
    kind = re.split(r"[:.]", str(action.get("class_type") or names[0]))[-1]
    if kind.endswith(("Action", "Limits")) and kind != "JointPositionAction":
        raise _OtherActionError(f"{action.where} is a {kind}, expected a JointPositionAction")
    values = action.fields({key: name for key, name in _ACTION.items() if action.get(key)})
    if joints := chosen_joints(action):
        values["action_joint_names"] = joints
    if action.get("use_default_offset") is False:
        values["action_offset"] = action.get("offset", 0.0)
    return values
