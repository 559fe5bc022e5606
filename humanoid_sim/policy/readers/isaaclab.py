"""`params/env.yaml` of Isaac Lab and mjlab: the environment that a policy was trained in, as its training wrote it.

Keys are those of Isaac Lab's `ManagerBasedRLEnvCfg`, which mjlab's resemble. The order of the joints is not in it:
Isaac Lab's is that of the simulation's articulation, breadth first.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from humanoid_sim.errors import InputError
from humanoid_sim.policy.layers import COMMAND_AXES, Layer
from humanoid_sim.policy.readers.trainer_files import is_group, isaac_scans, mapping, number, observation_fields
from humanoid_sim.strict_yaml import TrainerLoader, read_yaml

ENV_FILE = "env.yaml"


def read_env(path: Path) -> list[Layer]:
    """Return gains, pose, scale, terms and rate."""
    where = str(path)
    document = mapping(read_yaml(path, loader=TrainerLoader), where)
    values: dict[str, Any] = {}
    sim = mapping(document, where, "sim")
    timestep = sim.get("dt", mapping(sim, f"{where}: sim", "mujoco").get("timestep"))
    if timestep is not None and document.get("decimation") is not None:
        values["policy_dt"] = number(timestep, f"{where}: sim.dt") * number(
            document["decimation"], f"{where}: decimation"
        )
    robot = mapping(document, where, "scene", "robot")
    pose = mapping(robot, f"{where}: scene.robot", "init_state", "joint_pos")
    if pose:
        values["default_joint_pos"] = {".*": 0.0, **pose}
    actuators = mapping(robot, f"{where}: scene.robot", "actuators")
    for key, name in (("stiffness", "joint_stiffness"), ("damping", "joint_damping"), ("effort_limit", "effort_limit")):
        found = {
            pattern: value
            for group in actuators
            for pattern, value in _by_pattern(mapping(actuators, where, group), key)
        }
        if found:
            values[name] = found
    values |= _action(mapping(document, where, "actions"), where)
    groups, scans = mapping(document, where, "observations"), dict[str, Any]()
    for name in ("policy", "actor"):  # Isaac Lab's name of the policy's group, and mjlab's, whose terms lie one deeper
        group = mapping(groups, f"{where}: observations", name)
        if is_group(group):
            terms, place = mapping(group, f"{where}: observations.{name}", "terms"), f"{where}: observations.{name}"
            values |= dict(observation_fields({**group, **terms, "terms": None}, place))
            scans |= {} if terms else dict(isaac_scans(group, place))  # mjlab's are its own
    ranges = mapping(document, where, "commands", "base_velocity", "ranges")
    if all(axis in ranges for axis in COMMAND_AXES):
        values["command_ranges"] = {axis: ranges[axis] for axis in COMMAND_AXES}
    if not values:
        return []
    order = f"{path.name} does not state the order of the joints (Isaac Lab's is breadth first)"
    assumed = [Layer("assumed (Isaac Lab)", scans, is_assumed=True)] if scans else []
    return [*assumed, Layer(path.name, values, unused=(order,) if "joint_stiffness" in values else ())]


def _by_pattern(group: Mapping[str, Any], key: str) -> list[tuple[str, Any]]:
    """Return one actuator group's values by patterns of joints; a limit of the simulation comes before the motor's."""
    value = group.get(f"{key}_sim") if group.get(f"{key}_sim") is not None else group.get(key)
    patterns = group.get("joint_names_expr") or []
    if value is None:
        return []
    if not isinstance(patterns, list) or not all(isinstance(pattern, str) for pattern in patterns):
        raise InputError(f"joint_names_expr is {patterns!r}, expected patterns of joint names")
    if not isinstance(value, Mapping):
        return [(pattern, value) for pattern in patterns]
    return [(f"(?=(?:{pattern})$){name}", item) for pattern in patterns for name, item in value.items()]


def _action(actions: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return what the one action of joint positions says."""
    terms = {name: term for name, term in actions.items() if isinstance(term, dict) and term.get("scale") is not None}
    if not terms:
        return {}
    if len(terms) > 1:
        raise InputError(f"{where}: actions are {', '.join(terms)}, expected one, of joint positions")
    (term,) = terms.values()
    values: dict[str, Any] = {"action_scale": term["scale"]}
    if term.get("use_default_offset") is False:
        values["action_offset"] = term.get("offset", 0.0)
    if term.get("clip"):
        values["position_clip"] = term["clip"]
    if term.get("joint_names"):
        values["action_joint_names"] = term["joint_names"]
    return values
