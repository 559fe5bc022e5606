"""Berkeley Humanoid Lite's deployment YAML: everything but the observation, whose terms that project's code fixes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from humanoid_sim.errors import InputError
from humanoid_sim.policy.layers import Layer
from humanoid_sim.policy.readers.trainer_files import Section
from humanoid_sim.strict_yaml import read_yaml

_FIELDS = {
    "joints": "joint_names",
    "joint_kp": "joint_stiffness",
    "joint_kd": "joint_damping",
    "default_joint_positions": "default_joint_pos",
    "effort_limits": "effort_limit",
    "action_scale": "action_scale",
    "action_indices": "action_joint_names",
    "policy_dt": "policy_dt",
}
_KNOWN_BY = {"joint_kp", "joint_kd", "default_joint_positions", "num_observations", "action_indices"}
_ENOUGH = 3  # keys of those by which a file is recognised; the missing ones are reported
_WITHOUT_EFFECT = (
    *("policy_checkpoint_path", "ip_robot_addr", "ip_host_addr", "ip_policy_obs_port", "ip_policy_acs_port"),
    *("control_dt", "physics_dt", "cutoff_freq", "num_joints", "num_actions", "num_observations"),
    *("default_base_position", "command_velocity", "history_length", "action_limit_lower", "action_limit_upper"),
)
_TERMS = ("velocity_commands", "base_ang_vel", "projected_gravity", "joint_pos", "joint_vel", "last_action")
"""In the order of the project's code; joints are the driven ones."""
_ACTION_LIMIT = 1e4  # the project's default clip of raw actions, which are in the hundreds where torque limits bind


def read_berkeley(path: Path, _: object) -> list[Layer]:
    """Return what the file states, and the terms that come with the dialect; nothing of some other file."""
    document = read_yaml(path)
    if not isinstance(document, dict) or len(document.keys() & _KNOWN_BY) < _ENOUGH:
        return []
    file = Section(document, str(path))
    values = file.fields(_FIELDS)
    if file.get("action_limit_upper") is not None:
        values["action_clip"] = file.number("action_limit_upper")
        if file.number("action_limit_lower") != -values["action_clip"]:
            raise InputError(f"{path}: action_limit_lower, action_limit_upper are not -x and x")
    history = int(file.number("history_length")) + 1 if file.get("history_length") is not None else 1
    values |= {"observation": _TERMS, "command_names": ("base_velocity",)}
    values |= {f"observation.{name}.history": history for name in _TERMS}
    if driven := values.get("action_joint_names"):
        values |= {f"observation.{name}.joints": driven for name in ("joint_pos", "joint_vel")}
    assumed: dict[str, Any] = {"action_limit": max(_ACTION_LIMIT, values.get("action_clip", 0.0))}
    if history > 1:
        assumed["history_layout"] = "per_step"
    others = [key for key in file if key not in (*_FIELDS, *_WITHOUT_EFFECT)]
    unused = (f"{path.name}: {', '.join(others)}: not read",) if others else ()
    return [Layer("assumed (Berkeley Humanoid Lite)", assumed), Layer(path.name, values, unused=unused)]
