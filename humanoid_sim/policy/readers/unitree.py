"""Unitree's `deploy.yaml`: everything but the names of the joints, which are given by their places on the robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import PhaseRule
from humanoid_sim.controllers.term_kinds import term_kind
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.files import is_file
from humanoid_sim.mit import HEIGHT_SCAN
from humanoid_sim.policy.readers.contract_yaml import COMMAND_AXES
from humanoid_sim.policy.readers.mjlab import GAIT_CLOCK
from humanoid_sim.policy.readers.partial import Given, PartialContract, assumed, given
from humanoid_sim.policy.readers.values import YamlDocument

DEPLOY_FILE = "deploy.yaml"
_SCAN: Mapping[str, Any] = MappingProxyType(
    {
        "at": "torso_link",
        "grid": (1.6, 1.0),
        "resolution": 0.1,
        "ray_order": "xy",
        "offset": 0.5,
        "range": 1e6,
        "miss": -1e6,
        "above": 20.0,
    }
)
"""Options equal to Isaac Lab's `height_scan` of the scanner in unitree_rl_lab's scenes (`RayCasterCfg`,
`GridPatternCfg`). There a ray that hits nothing counts as endlessly high ground, and the term's clip bounds it."""
_SWITCHES = ("use_gym_history", "scale_first")


def find_deploy(checkpoint: Path) -> Path | None:
    """Give the file beside the model, or in `params/` beside the folder `exported/` that holds it; None without one."""
    folder = checkpoint.absolute().parent
    places = [folder / DEPLOY_FILE, folder / "params" / DEPLOY_FILE]
    if folder.name == "exported":
        places.append(folder.parent / "params" / DEPLOY_FILE)
    return next((place for place in places if is_file(place)), None)


def read_deploy(path: Path) -> PartialContract:
    """Return what the file states.

    Gains are listed in the robot's order, everything else in the policy's: `joint_ids_map` leads from the one to the
    other.
    """
    reader = _Reader(path)
    fields = {name: Given(value, path.name) for name, value in reader.fields().items()}
    terms = {name: given(path.name, options) for name, options in reader.terms.items()}
    implied = assumed("Unitree", {"reference_quaternion": "wxyz"})
    if any(term_kind(name).requires == "phase" for name in reader.terms):
        implied |= assumed("Unitree", {**GAIT_CLOCK, "phase.advance_first": True})
    # Without `joint_ids_map` the joints are in the robot's own order.
    implied |= given(path.name, {"joint_places": slice(None)})
    return PartialContract(path.name, fields, terms, implied, assumed_kinds={HEIGHT_SCAN: assumed("Isaac Lab", _SCAN)})


class _Reader(YamlDocument):
    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.terms: dict[str, dict[str, Any]] = {}
        self.commands: list[str] = []
        self.patterns: list[str] = []
        """Patterns of joint names, wherever the file has one."""

    def fields(self) -> dict[str, Any]:
        fields: dict[str, Any] = {}
        places = None
        if self.document.get("joint_ids_map") is not None:
            accepted = "places on the robot, each a whole number >= 0, none twice"
            places = fields["joint_places"] = self.places(self.document["joint_ids_map"], "joint_ids_map", accepted)
        if "step_dt" in self.document:
            fields["policy_dt"] = self.number(self.document["step_dt"], "step_dt")
        for key in ("stiffness", "damping"):
            if self.document.get(key) is not None:
                values = self.numbers(self.document[key], key)
                fields[f"joint_{key}"] = self._policy_order(values, places, key)
        if self.document.get("default_joint_pos") is not None:
            fields["default_joint_pos"] = self.numbers(self.document["default_joint_pos"], "default_joint_pos")
        fields |= self._commands() | self._action() | self._observations()
        if self.patterns:
            fields["joint_patterns"] = tuple(dict.fromkeys(self.patterns))
        if "command_names" not in fields and self.commands:
            fields["command_names"] = tuple(dict.fromkeys(self.commands))
        return fields

    def _policy_order(self, values: Any, places: tuple[int, ...] | None, key: str) -> Any:
        if places is None or np.ndim(values) == 0:
            return values
        if len(values) > max(places):
            return values[list(places)]
        if len(values) == len(places):  # the robot lacks some joints of the full one, and so does the list
            return values[[sorted(places).index(place) for place in places]]
        expected = f"{max(places) + 1} values, as joint_ids_map leads to place {max(places)}, or {len(places)}"
        raise self.wrong(key, f"{len(values)} values", expected)

    def _commands(self) -> dict[str, Any]:
        commands = self.mapping(self.document.get("commands") or {}, "commands")
        fields: dict[str, Any] = {}
        if commands:
            fields["command_names"] = tuple(commands)
        velocity = self.mapping(commands.get("base_velocity") or {}, "commands.base_velocity")
        ranges = self.mapping(velocity.get("ranges") or {}, "commands.base_velocity.ranges")
        if ranges:
            rows = [self.pair(ranges.get(name), f"commands.base_velocity.ranges.{name}") for name in COMMAND_AXES]
            fields["command_ranges"] = np.array(rows)
        return fields

    def _action(self) -> dict[str, Any]:
        actions = self.mapping(self.document.get("actions") or {}, "actions")
        if not actions:
            return {}
        if tuple(actions) != ("JointPositionAction",):
            raise self.wrong("actions", ", ".join(map(str, actions)), "JointPositionAction alone")
        where = "actions.JointPositionAction"
        action = self.mapping(actions["JointPositionAction"], where)
        fields: dict[str, Any] = {}
        for key, field in (("scale", "action_scale"), ("offset", "action_offset")):
            if action.get(key) is not None:
                fields[field] = self.numbers(action[key], f"{where}.{key}")
        if action.get("clip") is not None:
            fields["position_clip"] = self._clip(action["clip"], f"{where}.clip")
        ids = action.get("joint_ids")
        if ids is not None and ids != slice(None):
            fields["action_joint_places"] = self._chosen(ids, f"{where}.joint_ids")
        elif action.get("joint_names") is not None:
            patterns = self.items(action["joint_names"], f"{where}.joint_names")
            if not all(isinstance(pattern, str) for pattern in patterns):
                raise self.wrong(f"{where}.joint_names", patterns, "patterns of joint names")
            fields["action_joint_patterns"] = tuple(patterns)
            self.patterns += patterns
        return fields

    def _observations(self) -> dict[str, Any]:
        group = self.mapping(self.document.get("observations") or {}, "observations")
        where = "observations"
        while len(group) == 1 and _is_group(next(iter(group.values()))):
            name, group = next(iter(group.items()))
            where = f"{where}.{name}"
        switches = {name: group.get(name, False) for name in _SWITCHES}
        for name, value in switches.items():
            if not isinstance(value, bool):
                raise self.wrong(f"{where}.{name}", value, "true or false")
        names = [str(name) for name in group if name not in _SWITCHES]
        fields: dict[str, Any] = {}
        for name in names:
            term = self.mapping(group[name] if group[name] is not None else {}, f"{where}.{name}")
            if _is_group(term):
                raise self.wrong(where, f"the groups {', '.join(names)}", "one group of terms, for one input")
            fields |= self._term(name, term, f"{where}.{name}", switches["scale_first"])
        if names:
            fields["observation"] = tuple(names)
            fields["history_layout"] = "per_step" if switches["use_gym_history"] else "per_term"
        return fields

    def _term(self, name: str, term: Mapping[str, Any], where: str, scale_first: bool) -> dict[str, Any]:
        options: dict[str, Any] = {"history": 1, "scale": 1.0}
        if term.get("scale") is not None:
            options["scale"] = self.numbers(term["scale"], f"{where}.scale")
        if term.get("clip") is not None:
            options["clip"] = self.pair(term["clip"], f"{where}.clip")
            if scale_first:
                options["clip"] = self._before_scaling(options, where)
        options["history"] = max(self.count(term.get("history_length", 1), f"{where}.history_length"), 1)
        params = self.mapping(term.get("params") or {}, f"{where}.params")
        if isinstance(params.get("command_name"), str):
            self.commands.append(params["command_name"])
        asset = self.mapping(params.get("asset_cfg") or {}, f"{where}.params.asset_cfg")
        names = asset.get("joint_names")
        self.patterns += [text for text in (names if isinstance(names, list) else [names]) if isinstance(text, str)]
        ids = asset.get("joint_ids")
        if ids is not None and ids != slice(None):
            options["joint_places"] = self._chosen(ids, f"{where}.params.asset_cfg.joint_ids")
        if term_kind(name).name == HEIGHT_SCAN and params.get("offset") is not None:
            options["offset"] = self.number(params["offset"], f"{where}.params.offset")
        self.terms[name] = options
        if term_kind(name).requires == "phase" and params.get("period") is not None:
            try:
                return {"phase.period": PhaseRule(self.number(params["period"], f"{where}.params.period")).period}
            except FieldError as error:
                raise InputError(f"{self.path}: {where}.params.{str(error).removeprefix('PhaseRule.')}") from None
        return {}

    def _before_scaling(self, options: Mapping[str, Any], where: str) -> tuple[float, float]:
        """Bounds of the scaled value as bounds of the value itself."""
        scale = np.unique(options["scale"])
        if len(scale) != 1 or not scale[0] > 0.0:
            raise self.wrong(f"{where}.scale", options["scale"], "one positive factor, as scale_first clips after it")
        low, high = options["clip"]
        return low / float(scale[0]), high / float(scale[0])

    def _chosen(self, ids: Any, where: str) -> Any:
        accepted = "a slice, or whole numbers >= 0, none twice"
        return ids if isinstance(ids, slice) else self.places(ids, where, accepted)

    def _clip(self, value: Any, where: str) -> Any:
        rows = self.items(value, where)
        if len(rows) == 2 and not any(isinstance(row, Sequence) for row in rows):
            return np.array([self.pair(rows, where)])
        return np.array([self.pair(row, f"{where}[{index}]") for index, row in enumerate(rows)])


def _is_group(value: Any) -> bool:
    """Tell a group, which holds terms, that is mappings, from a term, which holds `params`, `scale` and the like."""
    if not isinstance(value, dict) or not value:
        return False
    terms = [item for key, item in value.items() if key not in (*_SWITCHES, "params")]
    return bool(terms) and all(isinstance(item, dict) for item in terms)
