"""Berkeley Humanoid Lite's deployment YAML: everything but the observation, whose terms that project's code fixes.

A file of this form comes with every checkpoint of the project: https://github.com/HybridRobotics/Berkeley-Humanoid-Lite.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from humanoid_sim.errors import InputError, one_line
from humanoid_sim.files import is_file
from humanoid_sim.policy.readers.partial import Given, PartialContract, assumed, given
from humanoid_sim.policy.readers.values import cut, is_number, plain_numbers
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
    reader = _Reader(path, read_yaml(path))
    fields = given(path.name, dict(reader.fields()))
    history = reader.count("history_length", 0, least=0) + 1
    fields |= given(_DIALECT, {"observation": _TERMS, "command_names": ("base_velocity",)})
    options: dict[str, dict[str, Given]] = {name: given(path.name, {"history": history}) for name in _TERMS}
    for name in ("joint_pos", "joint_vel"):
        options[name] |= given(path.name, {"joint_places": reader.driven})
    # Without names the joints are in the robot's own order.
    implied = given(path.name, {} if reader.names else {"joint_places": slice(None)})
    implied |= assumed(_DIALECT, {"action_limit": max(_ACTION_LIMIT, reader.clip or 0.0), "history_layout": "per_step"})
    if history == 1:
        del implied["history_layout"]
    return PartialContract(path.name, fields, options, implied)


class _Reader:
    def __init__(self, path: Path, document: Any) -> None:
        self.path = path
        self.document: Mapping[str, Any] = document
        driven = document["action_indices"]
        self.size = self.count("num_joints", len(driven) if isinstance(driven, list) else 1, least=1)
        self.names = document.get("joints")
        is_list = isinstance(self.names, list | tuple) and all(isinstance(name, str) for name in self.names)
        if self.names is not None and not (is_list and len(self.names) == self.size):
            raise self._wrong("joints", self.names, f"{self.size} names, as num_joints says")
        self.driven = self._indices()
        lower, upper = (document.get(f"action_limit_{end}") for end in ("lower", "upper"))
        self.clip: float | None = None
        if lower is not None or upper is not None:
            if not (is_number(lower) and is_number(upper) and lower == -upper and upper > 0):
                raise self._wrong("action_limit_lower, action_limit_upper", [lower, upper], "-x and x, with x > 0")
            self.clip = float(upper)

    def fields(self) -> Iterator[tuple[str, Any]]:
        if self.names:
            yield "joint_names", tuple(self.names)
        for key, field in (
            ("joint_kp", "joint_stiffness"),
            ("joint_kd", "joint_damping"),
            ("default_joint_positions", "default_joint_pos"),
        ):
            yield field, self._numbers(key, self.size)
        if self.document.get("effort_limits") is not None:
            yield "effort_limit", self._numbers("effort_limits", self.size)
        if self.document.get("action_scale") is not None:
            yield "action_scale", self._numbers("action_scale", len(self.driven))
        if self.document.get("policy_dt") is not None:
            if not is_number(self.document["policy_dt"]):
                raise self._wrong("policy_dt", self.document["policy_dt"], "a number")
            yield "policy_dt", float(self.document["policy_dt"])
        yield "action_joint_places", self.driven
        if self.clip is not None:
            yield "action_clip", self.clip

    def count(self, key: str, default: int, least: int) -> int:
        value = self.document.get(key, default)
        if type(value) is not int or not least <= value <= 1000:
            raise self._wrong(key, value, f"a whole number >= {least}")
        return value

    def _indices(self) -> tuple[int, ...]:
        value = self.document["action_indices"]
        is_list = isinstance(value, list) and all(type(i) is int and 0 <= i < self.size for i in value)
        if not is_list or not value or len(set(value)) < len(value):
            raise self._wrong("action_indices", value, f"places of joints, 0 to {self.size - 1}, none twice")
        return tuple(value)

    def _numbers(self, key: str, size: int) -> Any:
        found = plain_numbers(self.document[key])
        if found is None or (isinstance(found, np.ndarray) and len(found) != size):
            raise self._wrong(key, self.document[key], f"a number, or {size} of them")
        return found

    def _wrong(self, key: str, value: Any, expected: str) -> InputError:
        return InputError(f"{self.path}: {one_line(f'{key} is {cut(str(value))}, expected {expected}')}")
