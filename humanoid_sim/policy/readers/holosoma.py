"""Metadata of models from holosoma, JSON: joints and gains; in later exports the whole `ExperimentConfig`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from humanoid_sim.errors import blaming
from humanoid_sim.policy.layers import Layer
from humanoid_sim.policy.readers.own import GOLDEN_KEY, unread_keys
from humanoid_sim.policy.readers.trainer_files import Section

_FIELDS = {"dof_names": "joint_names", "kp": "joint_stiffness", "kd": "joint_damping", "action_scale": "action_scale"}
_KNOWN = (*_FIELDS, "command_ranges", "experiment_config")
_WITHOUT_EFFECT = ("robot_urdf", "robot_urdf_path", "wandb_run_path", "iteration", GOLDEN_KEY)


def read_holosoma(metadata: Mapping[str, str], where: str) -> list[Layer]:
    """Return joints, gains and command ranges, and from `experiment_config` pose, scale, terms and rate."""
    if "dof_names" not in metadata:
        return []
    keys = Section({key: _json(key, metadata[key], where) for key in _KNOWN if key in metadata}, where)
    values = keys.fields(_FIELDS)
    if ranges := keys.at("command_ranges"):
        values["command_ranges"] = [ranges.get(axis) for axis in ("lin_vel_x", "lin_vel_y", "ang_vel_yaw")]
    values = _experiment(keys.at("experiment_config"), values) | values
    assumed: dict[str, Any] = {"policy_dt": 0.02}
    if "phase.period" in values:  # holosoma's LocomotionGait
        assumed |= {"phase.offsets": [0.0, np.pi], "phase.standing_threshold": 0.01, "phase.standing_value": np.pi}
    unused = unread_keys(metadata, (*_KNOWN, *_WITHOUT_EFFECT))
    return [Layer("assumed (holosoma)", assumed), Layer("holosoma metadata", values, unused=unused)]


def _experiment(config: Section, values: Mapping[str, Any]) -> dict[str, Any]:
    robot = config.at("robot")
    control, efforts = robot.at("control"), robot.get("dof_effort_limit_list")
    found = control.fields({"action_scale": "action_scale"})
    if pose := robot.at("init_state", "default_joint_angles"):
        found["default_joint_pos"] = {".*": 0.0, **pose}
    stiffness = values.get("joint_stiffness")
    by_effort = control.get("action_scales_by_effort_limit_over_p_gain")
    if "action_scale" in found and by_effort and efforts and stiffness:
        scale = control.number("action_scale")
        found["action_scale"] = [scale * effort / kp for effort, kp in zip(efforts, stiffness, strict=False)]
    if control.get("clip_actions"):
        found |= control.fields({"action_clip_value": "action_clip"})
    if control.get("clip_torques") and efforts:
        found["effort_limit"] = efforts
    sim = config.at("simulator", "config", "sim")
    if sim.get("fps") and sim.get("control_decimation"):
        found["policy_dt"] = sim.number("control_decimation") / sim.number("fps")
    group = config.at("observation", "groups", "actor_obs")
    names = sorted(group.at("terms"))
    if names:
        found["observation"] = names
    for name in names:
        found[f"observation.{name}.scale"] = group.at("terms", name).get("scale", 1.0)
        found[f"observation.{name}.history"] = group.get("history_length", 1)
    period = config.at("command", "setup_terms", "locomotion_gait", "params").get("gait_period")
    if period and any("phase" in name for name in names):
        found["phase.period"] = period
    return found


def _json(key: str, text: str, where: str) -> Any:
    with blaming(f"{where}: {key} is {text[:80]!r}, expected JSON", ValueError):
        return json.loads(text)
