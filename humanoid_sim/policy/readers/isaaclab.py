"""`params/env.yaml` of Isaac Lab and mjlab: the environment that a policy was trained in, as its training wrote it.

Keys are those of Isaac Lab's `ManagerBasedRLEnvCfg`, which mjlab's resemble. The order of the joints is not in it:
Isaac Lab's is that of the simulation's articulation, breadth first.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from humanoid_sim.errors import InputError
from humanoid_sim.policy.layers import COMMAND_AXES, Layer
from humanoid_sim.policy.readers.trainer_files import Section, is_group, isaac_scans, observation_fields, read_section

_GAINS = {"stiffness": "joint_stiffness", "damping": "joint_damping", "effort_limit": "effort_limit"}
_ACTION = {"scale": "action_scale", "clip": "position_clip", "joint_names": "action_joint_names"}


def read_env(path: Path) -> list[Layer]:
    """Return gains, pose, scale, terms and rate."""
    file = read_section(path)
    values: dict[str, Any] = {}
    scans: dict[str, Any] = {}
    physics, key = (file["sim"], "dt") if "dt" in file["sim"].values else (file["sim"]["mujoco"], "timestep")
    if physics.get(key) is not None and file.get("decimation") is not None:
        values["policy_dt"] = physics.number(key) * file.number("decimation")
    robot = file["scene"]["robot"]
    pose = robot["init_state"]["joint_pos"].values
    if pose:
        values["default_joint_pos"] = {".*": 0.0, **pose}
    for key, name in _GAINS.items():
        groups = [robot["actuators"][group] for group in robot["actuators"].values]
        found = {pattern: value for group in groups for pattern, value in _by_pattern(group, key)}
        if found:
            values[name] = found
    values |= _action(file["actions"])
    for name in ("policy", "actor"):  # Isaac Lab's name of the policy's group, and mjlab's, whose terms lie one deeper
        group = file["observations"][name]
        if is_group(group.values):
            terms = group["terms"].values
            values |= observation_fields(Section({**group.values, **terms, "terms": None}, group.where))
            scans |= {} if terms else isaac_scans(group)  # mjlab's are its own
    ranges = file["commands"]["base_velocity"]["ranges"]
    if all(axis in ranges.values for axis in COMMAND_AXES):
        values["command_ranges"] = [ranges.get(axis) for axis in COMMAND_AXES]
    order = f"{path.name} does not state the order of the joints (Isaac Lab's is breadth first)"
    unused = (order,) if "joint_stiffness" in values else ()
    return [Layer("assumed (Isaac Lab)", scans), Layer(path.name, values, unused=unused)]


def _by_pattern(group: Section, key: str) -> Iterator[tuple[str, Any]]:
    value = group.get(key) if group.get(f"{key}_sim") is None else group.get(f"{key}_sim")
    for pattern in group.get("joint_names_expr") or []:
        if isinstance(value, dict):
            yield from ((f"(?=(?:{pattern})$){name}", item) for name, item in value.items())
        elif value is not None:
            yield pattern, value


def _action(actions: Section) -> dict[str, Any]:
    names = [name for name, term in actions.values.items() if isinstance(term, dict) and term.get("scale") is not None]
    if not names:
        return {}
    if len(names) > 1:
        raise InputError(f"{actions.where} are {', '.join(names)}, expected one, of joint positions")
    action = actions[names[0]]
    values = action.fields({key: name for key, name in _ACTION.items() if action.get(key)})
    if action.get("use_default_offset") is False:
        values["action_offset"] = action.values.get("offset", 0.0)
    return values
