"""Berkeley Humanoid Lite's deployment YAML: everything but the observation, whose terms that project's code fixes.

A file of this form comes with every checkpoint of the project: https://github.com/HybridRobotics/Berkeley-Humanoid-Lite.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from humanoid_sim.errors import InputError
from humanoid_sim.files import is_file
from humanoid_sim.policy.layers import ROBOTS_ORDER, Layer
from humanoid_sim.policy.words import shown
from humanoid_sim.strict_yaml import read_yaml

_KEYS = frozenset({"joint_kp", "joint_kd", "default_joint_positions", "num_observations", "action_indices"})
"""By which the dialect is known."""
_TERMS = ("velocity_commands", "base_ang_vel", "projected_gravity", "joint_pos", "joint_vel", "last_action")
"""In the order of the project's code; joints are the driven ones."""
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
_ACTION_LIMIT = 1e4
"""The project's default for the clip of raw actions: they are in the hundreds where torque limits bind."""


def find_berkeley(checkpoint: Path) -> Path | None:
    """Give the file that names the model, or has its stem: beside it, or in `configs/` next to it or to its folder."""
    folder = checkpoint.absolute().parent
    for place in (folder, folder / "configs", folder.parent / "configs"):
        own = place / f"{checkpoint.stem}.yaml"
        if _is_berkeley(own):
            return own
        others = sorted(place.glob("*.yaml")) if place.name == "configs" else []
        for other in others:
            if (
                _is_berkeley(other)
                and Path(str(read_yaml(other).get("policy_checkpoint_path"))).name == checkpoint.name
            ):
                return other
    return None


def _is_berkeley(path: Path) -> bool:
    try:
        document = read_yaml(path) if is_file(path) else None
    except InputError:  # some other file
        return False
    return isinstance(document, dict) and document.keys() >= _KEYS


def read_berkeley(path: Path, robot_joints: tuple[str, ...] | None) -> list[Layer]:
    """Return what the file states, and the terms that come with the dialect."""
    document = read_yaml(path)
    values = {name: document[key] for key, name in _FIELDS.items() if document.get(key) is not None}
    lower, upper = document.get("action_limit_lower"), document.get("action_limit_upper")
    if lower is not None or upper is not None:
        if not isinstance(upper, int | float) or lower != -upper or upper <= 0:
            where = "action_limit_lower, action_limit_upper"
            raise InputError(f"{path}: {where} are {shown([lower, upper])}, expected -x and x, with x > 0")
        values["action_clip"] = upper
    history = int(document.get("history_length") or 0) + 1
    values |= {"observation": _TERMS, "command_names": ("base_velocity",)}
    values |= {f"observation.{name}.history": history for name in _TERMS}
    values |= {f"observation.{name}.joints": values["action_joint_names"] for name in ("joint_pos", "joint_vel")}
    assumed: dict[str, Any] = {"action_limit": max(_ACTION_LIMIT, values.get("action_clip", 0.0))}
    if history > 1:
        assumed["history_layout"] = "per_step"
    layers = [Layer("assumed (Berkeley Humanoid Lite)", assumed, is_assumed=True), Layer(path.name, values)]
    if (
        "joint_names" not in values and robot_joints is not None
    ):  # without names the joints are in the robot's own order
        layers.append(Layer(ROBOTS_ORDER, {"joint_names": robot_joints}, is_assumed=True))
    return layers
