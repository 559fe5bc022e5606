"""The project's own forms of a contract: thirteen metadata keys, a stamp that holds all of it, and `contract.yaml`."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import PhaseRule, PolicyContract
from humanoid_sim.errors import FieldError, InputError, blaming, known_names
from humanoid_sim.files import is_file
from humanoid_sim.policy.findings import shown
from humanoid_sim.policy.layers import COMMAND_AXES, REQUIRED, Layer, build, checked
from humanoid_sim.strict_yaml import read_yaml

STAMP_KEY = "humanoid_sim_contract"  # metadata key under which a stamped checkpoint carries its contract
GOLDEN_KEY = "humanoid_sim_golden"  # of the golden vectors
_VERSION = 2
_NUMBERS = ("joint_stiffness", "joint_damping", "default_joint_pos", "action_scale", "policy_dt")
_TEXTS = ("task_type", "dataset_repo_id", "anchor_body")
METADATA_KEYS = (
    *("task_type", "joint_names", "action_joint_names", *_NUMBERS[:3], "observation_names", "command_names"),
    *("action_scale", "policy_dt", "body_names", "dataset_repo_id", "lookahead_steps"),
)
"""The thirteen keys of a self-describing checkpoint. Lists are CSV, as mjlab's exporter writes them."""
OWN_KEYS = {"task_type", "action_joint_names", "policy_dt", "dataset_repo_id", "lookahead_steps"}  # of no other dialect


# --- thirteen keys of CSV ---


def csv(text: str) -> list[str]:
    """Return the items without the space around them; empty text is an empty list."""
    return [item.strip() for item in text.split(",")] if text.strip() else []


def csv_numbers(key: str, text: str, where: str) -> list[float]:
    """Return the numbers of a CSV text, at least one. Raises `InputError` naming the key."""
    with blaming(f"{where}: {key} is {text[:80]!r}, expected numbers separated by commas", ValueError):
        return [float(item) for item in csv(text) or [""]]


def csv_field(name: str, key: str, text: str, where: str) -> Any:
    """Return a field of the contract from the text of a metadata key."""
    if name in _TEXTS:
        return text.strip()
    if name == "lookahead_steps":
        numbers = csv_numbers(key, text, where) if text.strip() else []
        return [int(number) if number.is_integer() else number for number in numbers]
    if name not in _NUMBERS:
        return csv(text)
    numbers = csv_numbers(key, text, where)
    return numbers[0] if len(numbers) == 1 else numbers


def read_own(metadata: Mapping[str, str], where: str) -> list[Layer]:
    """Return what the thirteen keys state."""
    names = {key: key.replace("observation_names", "observation") for key in METADATA_KEYS if key in metadata}
    return [Layer("metadata", {name: csv_field(name, key, metadata[key], where) for key, name in names.items()})]


def write_metadata(contract: PolicyContract) -> dict[str, str]:
    """Return the thirteen keys of a contract, numbers with all their digits; `FieldError` for a name with a comma."""
    return {key: _csv_text(key, getattr(contract, key)) for key in METADATA_KEYS}


def _csv_text(key: str, value: Any) -> str:
    if isinstance(value, str):
        return value.strip()
    items = [value] if isinstance(value, float) else list(value)
    for name in items:
        if isinstance(name, str) and ("," in name or name != name.strip()):
            raise FieldError(f"PolicyContract.{key}: {name!r} has a comma or outer spaces, which CSV cannot keep")
    return ",".join(repr(float(item)) if isinstance(item, float) else str(item) for item in items)


# --- JSON of a whole contract ---


def plain(value: Any) -> Any:
    """Return a contract, or a field's value, as JSON and YAML have it; a float64's repr keeps every bit."""
    if is_dataclass(value):
        values = {item.name: plain(getattr(value, item.name)) for item in fields(value) if item.name != "source"}
        if isinstance(value, PolicyContract):
            return values
        return {name: item for name, item in values.items() if item is not None or name == "standing_value"}
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [plain(item) for item in value] if isinstance(value, tuple | list) else value


def encode(contract: PolicyContract) -> str:
    """Return one line of JSON from which `decode` makes the same contract again, bit for bit."""
    return json.dumps({"version": _VERSION, "contract": plain(contract), "source": dict(contract.source)})


def _decoded(text: str, where: str) -> tuple[dict[str, Any], PolicyContract]:
    """Return the fields of a text of `encode`, as layers hold them, and the contract."""
    with blaming(f"{where}: contract", (ValueError, KeyError, TypeError)):
        document = json.loads(text)
        if document["version"] != _VERSION:
            raise ValueError(f"has version {document['version']!r}, expected {_VERSION}")
        stated = dict(flattened(document["contract"], f"{where}: contract"))
        stated.pop("phase.speed", None)  # in older stamps, without a meaning of its own
        values = {name: checked(name, value, f"{where}: contract: {name}") for name, value in stated.items()}
        return values, build(values, document["source"])


def decode(text: str, where: str) -> PolicyContract:
    """Return the contract in a text of `encode`, sources included."""
    return _decoded(text, where)[1]


def read_stamp(metadata: Mapping[str, str], where: str) -> list[Layer]:
    """Return a stamped contract, and of the thirteen keys beside it those that were changed since.

    The contract keeps the sources that its fields had; usual values without one are nobody's statement.
    """
    values, made = _decoded(metadata[STAMP_KEY], where)
    phase = None if made.phase is None else PhaseRule(1.0)
    kept = ("task_type", "action_joint_names", "command_names", *REQUIRED)
    required = {name: getattr(made, name) for name in (*kept, *(["lookahead_steps"] if made.lookahead_steps else []))}
    usual_contract = PolicyContract(**{**required, "observation": made.observation_names}, phase=phase)
    usual = dict(flattened(plain(usual_contract), where))
    layers: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        origin = made.source.get(name, "")
        is_usual = name in usual and name not in required and name != "phase.period" and plain(value) == usual[name]
        if not origin.startswith("follows from") and (origin or not is_usual):
            layers.setdefault(origin or "stamp", {})[name] = value
    (stamped,), (beside,) = read_own(write_metadata(made), where), read_own(metadata, where)
    changed = {name: value for name, value in beside.values.items() if value != stamped.values[name]}
    return [*(Layer(origin, group) for origin, group in layers.items()), Layer("metadata", changed)]


# --- contract.yaml ---


def own_contract(checkpoint: Path) -> Path:
    """Return where a checkpoint's contract belongs: `<checkpoint's stem>.contract.yaml` in its folder."""
    return checkpoint.with_name(f"{checkpoint.stem}.contract.yaml")


def find_contract(checkpoint: Path) -> Path | None:
    """Return `<checkpoint's stem>.contract.yaml`, or else `contract.yaml`, in its folder; None without one."""
    places = (own_contract(checkpoint), checkpoint.with_name("contract.yaml"))
    return next((path for path in places if is_file(path)), None)


def read_contract_file(path: Path) -> Layer:
    """Return what a person wrote about a checkpoint: any field, which decides between all other sources."""
    return Layer(path.name, dict(flattened(read_yaml(path) or {}, str(path))), is_decisive=True)


def flattened(document: Any, where: str) -> Iterator[tuple[str, Any]]:
    """Yield the fields of a contract in JSON or YAML, as in `Layer.values`."""
    known = [*(item.name for item in fields(PolicyContract) if item.name != "source"), "terms"]
    for name, value in _mapping(document, where).items():
        options: Any = {}
        if name == "terms":
            options = _mapping(value, f"{where}: terms")
        elif name in ("phase", "tensors") and value is not None:
            for part, item in _mapping(value, f"{where}: {name}").items():
                yield f"{name}.{part}", item
        elif name == "observation" and isinstance(value, list):
            yield name, [term.get("name") if isinstance(term, dict) else term for term in value]
            options = {str(term.get("name")): term for term in value if isinstance(term, dict)}
        elif name == "command_ranges" and isinstance(value, dict):
            yield name, [value.get(axis) for axis in COMMAND_AXES]
        elif name in known:
            yield name, value
        else:
            raise InputError(f"{where}: {known_names('field', str(name), known)}")
        for term, values in options.items():
            for option, item in _mapping(values, f"{where}: term {term}").items():
                if option != "name":
                    yield f"observation.{term}.{option}", item


def _mapping(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{where}: is {shown(value)}, expected a mapping")
    return value
