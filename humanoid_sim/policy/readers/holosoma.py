"""Metadata of models from holosoma: JSON. Older exports hold joints and gains, later ones the whole experiment.

The keys of `experiment_config` are those of holosoma's `ExperimentConfig`: github.com/amazon-far/holosoma.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.policy.layers import Layer
from humanoid_sim.policy.readers.own import GOLDEN_KEY, csv_numbers

_SOURCE = "holosoma metadata"
_AXES = ("lin_vel_x", "lin_vel_y", "ang_vel_yaw")
_EXPERIMENT = "experiment_config"
_KNOWN = ("dof_names", "kp", "kd", "action_scale", "command_ranges", _EXPERIMENT)
_WITHOUT_EFFECT = ("robot_urdf", "robot_urdf_path", "wandb_run_path", "iteration", GOLDEN_KEY)


def is_holosoma(metadata: Mapping[str, str]) -> bool:
    """Return whether the metadata has the key by which this dialect is known."""
    return "dof_names" in metadata


def read_holosoma(metadata: Mapping[str, str], where: str) -> list[Layer]:
    """Return joints, gains and command ranges, and from `experiment_config` pose, scale, terms and rate."""
    values: dict[str, Any] = {"joint_names": _json("dof_names", metadata, where)}
    for key, name in (("kp", "joint_stiffness"), ("kd", "joint_damping")):
        if key in metadata:
            values[name] = _json(key, metadata, where)
    if "action_scale" in metadata:  # JSON, or CSV within quotes
        text = metadata["action_scale"].strip().strip('"')
        is_list = text.startswith("[")
        values["action_scale"] = json.loads(text) if is_list else csv_numbers("action_scale", text, where)
    ranges = _json("command_ranges", metadata, where) if "command_ranges" in metadata else None
    if isinstance(ranges, dict):
        values["command_ranges"] = [ranges.get(axis) for axis in _AXES]
    if _EXPERIMENT in metadata:
        values |= _experiment(_json(_EXPERIMENT, metadata, where), values)
    unused = tuple(f"metadata key '{key}' is not read" for key in metadata if key not in (*_KNOWN, *_WITHOUT_EFFECT))
    assumed: dict[str, Any] = {"policy_dt": 0.02}
    if "phase.period" in values:  # holosoma's LocomotionGait
        assumed |= {"phase.offsets": [0.0, np.pi], "phase.standing_threshold": 0.01, "phase.standing_value": np.pi}
    return [Layer("assumed (holosoma)", assumed, is_assumed=True), Layer(_SOURCE, values, unused=unused)]


def _experiment(config: Any, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields that holosoma's experiment configuration gives; terms stand in alphabetical order."""
    robot, found = _at(config, "robot"), dict[str, Any]()
    pose = _at(robot, "init_state", "default_joint_angles")
    if pose:
        found["default_joint_pos"] = {".*": 0.0, **pose}
    control = _at(robot, "control")
    if "action_scale" in control and "action_scale" not in values:
        scale = control["action_scale"]
        efforts, stiffness = robot.get("dof_effort_limit_list"), values.get("joint_stiffness")
        if control.get("action_scales_by_effort_limit_over_p_gain") and efforts and stiffness:
            scale = [scale * effort / kp for effort, kp in zip(efforts, stiffness, strict=False)]
        found["action_scale"] = scale
    if control.get("clip_actions") and "action_clip_value" in control:
        found["action_clip"] = control["action_clip_value"]
    if robot.get("dof_effort_limit_list") and control.get("clip_torques"):
        found["effort_limit"] = robot["dof_effort_limit_list"]
    sim = _at(config, "simulator", "config", "sim")
    if sim.get("fps") and sim.get("control_decimation"):
        found["policy_dt"] = sim["control_decimation"] / sim["fps"]
    group = _at(config, "observation", "groups", "actor_obs")
    names = sorted(group.get("terms") or {})
    if names:
        found["observation"] = names
    for name in names:
        term = group["terms"][name]
        found[f"observation.{name}.scale"] = term.get("scale", 1.0)
        found[f"observation.{name}.history"] = group.get("history_length", 1)
    period = _at(config, "command", "setup_terms", "locomotion_gait", "params").get("gait_period")
    if period and any("phase" in name for name in names):
        found["phase.period"] = period
    return found


def _at(document: Any, *keys: str) -> dict[str, Any]:
    """Return the mapping at a place; an empty one where there is none."""
    for key in keys:
        document = document.get(key) if isinstance(document, dict) else None
    return document if isinstance(document, dict) else {}


def _json(key: str, metadata: Mapping[str, str], where: str) -> Any:
    try:
        return json.loads(metadata[key])
    except ValueError:
        raise InputError(f"{where}: {key} is {metadata[key][:80]!r}, expected JSON") from None
