"""Files that trainers write beside a model: where they lie, and the observation groups that several have in common."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from humanoid_sim.controllers.terms import term_kind
from humanoid_sim.errors import InputError
from humanoid_sim.policy.findings import shown
from humanoid_sim.strict_yaml import read_yaml


def find_beside(checkpoint: Path, name: str) -> Path | None:
    """Return a file beside the model, or in `params/` or `configs/` there or one folder up."""
    folder = checkpoint.absolute().parent
    places = [folder, *(above / place for above in (folder, folder.parent) for place in ("params", "configs"))]
    return next((place / name for place in places if os.path.isfile(place / name)), None)


class Section(dict[str, Any]):
    """A mapping in a trainer's file, and where it stands. What is null or absent is empty."""

    def __init__(self, document: Any, where: str) -> None:
        if not isinstance(document, dict | None):
            raise InputError(f"{where}: is {shown(document)}, expected a mapping")
        super().__init__({str(key): value for key, value in (document or {}).items()})
        self.where = where

    def at(self, *keys: str) -> Section:
        """Return the mapping within, key by key."""
        section = self
        for key in keys:
            section = Section(section.get(key), f"{section.where}: {key}")
        return section

    def number(self, key: str) -> float:
        value = self.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{self.where}: {key} is {shown(value)}, expected a number")
        return float(value)

    def fields(self, names: Mapping[str, str]) -> dict[str, Any]:
        """Return the values that are there, by the field of the contract that each key stands for."""
        return {name: self[key] for key, name in names.items() if self.get(key) is not None}


def read_section(path: Path) -> Section:
    """Return a trainer's YAML file. Raises `InputError` if it holds nothing."""
    document = read_yaml(path)
    if document is None:
        raise InputError(f"{path}: is empty, expected the trainer's settings")
    return Section(document, str(path))


def is_group(value: Any) -> bool:
    """Return True for a group of terms, which are mappings; a term's own are `params`, `noise` and `func`."""
    if not isinstance(value, dict) or "func" in value:
        return False
    return any(isinstance(item, dict) and key not in ("params", "noise") for key, item in value.items())


def observation_fields(group: Section) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the fields of a contract that an observation group of Isaac Lab's form gives, and what is not read."""
    names = [name for name, term in group.items() if isinstance(term, dict)]
    if not names:
        return {}, ()
    stacked = group.get("use_gym_history") is True
    found: dict[str, Any] = {"observation": names, "history_layout": "per_step" if stacked else "per_term"}
    unused = (
        ["concatenate_terms is false, but a policy has one input"] if group.get("concatenate_terms") is False else []
    )
    commands: list[str] = []
    for name in names:
        if is_group(group[name]):
            raise InputError(f"{group.where}: has the groups {', '.join(names)}, expected one, for one input")
        term, params, field = group.at(name), group.at(name, "params"), f"observation.{name}"
        function = str(term.get("func") or "").rpartition(":")[2].replace("generated_commands", "command")
        kind, computed = term_kind(name), term_kind(function)
        if function and computed.meaning != "live input":  # the function counts, whatever the term is called
            found |= {f"{field}.kind": function} if computed.name != kind.name else {}
            kind = computed
        elif function not in ("", "builtin_sensor"):  # mjlab's, of any sensor
            unused.append(f"{name} is computed by {term['func']}, but taken for {kind.name}")
        if term.get("modifiers"):
            unused.append(f"{name} has modifiers, which are not applied")
        if kind.name == "joint_pos" and function in ("joint_pos", "joint_pos_rel"):
            found[f"{field}.relative"] = function == "joint_pos_rel"
        scale = 1.0 if term.get("scale") is None else term["scale"]
        found[f"{field}.scale"] = scale
        if term.get("clip") is not None:
            factor = scale if group.get("scale_first") is True else 1.0
            found[f"{field}.clip"] = [bound / factor for bound in term["clip"]]
        history = term.get("history_length") if group.get("history_length") is None else group["history_length"]
        found[f"{field}.history"] = history or 1  # 0: no history, the present step alone
        if isinstance(params.get("command_name"), str):
            commands.append(params["command_name"])
        if kind.reads.startswith("joint_") and (joints := chosen_joints(params.at("asset_cfg"))):
            found[f"{field}.joints"] = joints
        if kind.requires == "phase" and params.get("period") is not None:
            found["phase.period"] = params.number("period")
    found |= {"command_names": list(dict.fromkeys(commands))} if commands else {}
    return found, tuple(f"{group.where}: {line}" for line in unused)


def chosen_joints(asset: Section) -> Any:
    """Return the joints of a term or an action by place or, as patterns, in the robot's order; None for all."""
    if asset.get("joint_ids") not in (None, slice(None)):
        return asset["joint_ids"]
    names = asset.get("joint_names") or asset.get("actuator_names") or []  # mjlab's actuators have their joints' names
    patterns = [names] if isinstance(names, str) else list(names)
    if patterns == [".*"] or asset.get("preserve_order") is True:
        return None if patterns == [".*"] else patterns
    return [f"(?:{pattern})" for pattern in patterns]
