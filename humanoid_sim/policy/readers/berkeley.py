"""Berkeley Humanoid Lite's deployment YAML: everything but the observation, whose terms that project's code fixes.

A file of this form comes with every checkpoint of the project: https://github.com/HybridRobotics/Berkeley-Humanoid-Lite.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from humanoid_sim.errors import InputError
from humanoid_sim.files import is_file
from humanoid_sim.policy.readers.partial import Given, PartialContract, assumed, given
from humanoid_sim.policy.readers.values import YamlDocument, is_number
from humanoid_sim.strict_yaml import read_yaml

_KEYS = frozenset({"joint_kp", "joint_kd", "default_joint_positions", "num_observations", "action_indices"})
"""By which the dialect is known."""
_TERMS = ("velocity_commands", "base_ang_vel", "projected_gravity", "joint_pos", "joint_vel", "last_action")
"""In the order of the project's code; joints are the driven ones."""
_DIALECT = "Berkeley Humanoid Lite"
_ACTION_LIMIT = 1e4
"""The project's default for the clip of raw actions: they are in the hundreds where torque limits bind."""


def find_berkeley(checkpoint: Path) -> Path | None:
    """Give the file that names the model, or has its stem: beside it, or in `configs/` next to it or to its folder."""
    folder = checkpoint.absolute().parent
    for place in (folder, folder / "configs", folder.parent / "configs"):
        own = place / f"{checkpoint.stem}.yaml"
        if _speaks(own):
            return own
        others = sorted(place.glob("*.yaml")) if place.name == "configs" else []
        for other in others:
            if _speaks(other) and Path(str(read_yaml(other).get("policy_checkpoint_path"))).name == checkpoint.name:
                return other
    return None


def _speaks(path: Path) -> bool:
    try:
        document = read_yaml(path) if is_file(path) else None
    except InputError:  # some other file, which is not asked
        return False
    return isinstance(document, dict) and document.keys() >= _KEYS


def read_berkeley(path: Path) -> PartialContract:
    """Return what the file states, and the terms that come with the dialect."""
    file = YamlDocument(path)
    fields = given(path.name, dict(_fields(file)))
    history = file.count(file.document.get("history_length", 0), "history_length") + 1
    fields |= given(_DIALECT, {"observation": _TERMS, "command_names": ("base_velocity",)})
    options: dict[str, dict[str, Given]] = {name: given(path.name, {"history": history}) for name in _TERMS}
    for name in ("joint_pos", "joint_vel"):
        options[name] |= given(path.name, {"joint_places": fields["action_joint_places"].value})
    # Without names the joints are in the robot's own order.
    implied = given(path.name, {} if "joint_names" in fields else {"joint_places": slice(None)})
    clip = fields["action_clip"].value if "action_clip" in fields else 0.0
    implied |= assumed(_DIALECT, {"action_limit": max(_ACTION_LIMIT, clip)})
    if history > 1:
        implied |= assumed(_DIALECT, {"history_layout": "per_step"})
    return PartialContract(path.name, fields, options, implied)


def _fields(file: YamlDocument) -> Iterator[tuple[str, Any]]:
    document = file.document
    indices, names = document["action_indices"], document.get("joints")
    size = file.count(document.get("num_joints", len(indices) if isinstance(indices, list) else 1), "num_joints", 1)
    driven = file.places(indices, "action_indices", f"places of joints, 0 to {size - 1}, none twice", size)
    if names is not None:
        if not isinstance(names, list) or len(names) != size or not all(isinstance(name, str) for name in names):
            raise file.wrong("joints", names, f"{size} names, as num_joints says")
        yield "joint_names", tuple(names)
    for key, field, count in (
        ("joint_kp", "joint_stiffness", size),
        ("joint_kd", "joint_damping", size),
        ("default_joint_positions", "default_joint_pos", size),
        ("effort_limits", "effort_limit", size),
        ("action_scale", "action_scale", len(driven)),
    ):
        if key in _KEYS or document.get(key) is not None:
            yield field, file.numbers(document[key], key, count)
    if document.get("policy_dt") is not None:
        yield "policy_dt", file.number(document["policy_dt"], "policy_dt")
    yield "action_joint_places", driven
    lower: Any = document.get("action_limit_lower")
    upper: Any = document.get("action_limit_upper")
    if lower is not None or upper is not None:
        if not (is_number(lower) and is_number(upper) and lower == -upper and upper > 0):
            raise file.wrong("action_limit_lower, action_limit_upper", [lower, upper], "-x and x, with x > 0")
        yield "action_clip", float(upper)
