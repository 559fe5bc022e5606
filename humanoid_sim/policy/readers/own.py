"""The project's own forms of a contract: thirteen metadata keys, a stamp that holds all of it, and `contract.yaml`."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import msgspec

from humanoid_sim.controllers.contract import PhaseRule, PolicyContract
from humanoid_sim.errors import FieldError, InputError, blaming, known_names, meant
from humanoid_sim.names import list_joints
from humanoid_sim.policy.layers import COMMAND_AXES, Layer, build, checked
from humanoid_sim.policy.readers.trainer_files import Section
from humanoid_sim.strict_yaml import read_yaml

STAMP_KEY = "humanoid_sim_contract"  # metadata key under which a stamped checkpoint carries its contract
GOLDEN_KEY = "humanoid_sim_golden"  # of the golden vectors
_VERSION = 2
_AROUND = " \t\r\n\"'[]()"  # of an item in a list, as Python or JSON write it
_NUMBERS = ("joint_stiffness", "joint_damping", "default_joint_pos", "action_scale", "policy_dt")
METADATA_KEYS = (
    *("task_type", "joint_names", "action_joint_names", *_NUMBERS[:3], "observation_names", "command_names"),
    *("action_scale", "policy_dt", "body_names", "dataset_repo_id", "lookahead_steps"),
)
"""The thirteen keys of a self-describing checkpoint. Lists are CSV, as mjlab's exporter writes them."""


def csv(text: str) -> list[str]:
    """Return the items without the space, quotes and brackets around them; empty text is an empty list."""
    return [item.strip(_AROUND) for item in text.split(",")] if text.strip(_AROUND) else []


def csv_numbers(key: str, text: str, where: str) -> list[float]:
    """Return the numbers of a CSV text, at least one. Raises `InputError` naming the key."""
    with blaming(f"{where}: {key} is {text[:80]!r}, expected numbers separated by commas", ValueError):
        return [float(item) for item in csv(text) or [""]]


def csv_field(key: str, text: str, where: str) -> Any:
    """Return a field of the contract from the text of a metadata key."""
    if key in _NUMBERS:
        numbers = csv_numbers(key, text, where)
        return numbers[0] if len(numbers) == 1 else numbers
    if key == "lookahead_steps":
        return [int(number) for number in csv_numbers(key, text, where)] if text.strip() else []
    return text.strip() if key in ("task_type", "dataset_repo_id", "anchor_body_name") else csv(text)


def unread_keys(metadata: Iterable[str], known: Sequence[str]) -> tuple[str, ...]:
    """Return a line about the keys that are not known, those first that are near a known one."""
    keys = [f"'{key}'{meant(key, known)}" for key in metadata if key not in known]
    keys.sort(key=lambda text: text.endswith("'"))
    return (f"metadata key {list_joints(keys)}: not read",) if keys else ()


def write_metadata(contract: PolicyContract) -> dict[str, str]:
    """Return the thirteen keys of a contract, numbers with all their digits; `FieldError` for a name with a comma."""
    return {key: _csv_text(key, getattr(contract, key)) for key in METADATA_KEYS}


def _csv_text(key: str, value: Any) -> str:
    if isinstance(value, str):
        return value.strip()
    items = [value] if isinstance(value, float) else list(value)
    texts = [repr(float(item)) if isinstance(item, float) else str(item) for item in items]
    if csv(",".join(texts)) != texts:
        raise FieldError(f"PolicyContract.{key}: {texts} have commas or outer spaces, which CSV cannot keep")
    return ",".join(texts)


def plain(value: Any) -> Any:
    """Return a contract, or a field's value, as JSON and YAML have it; a float64's repr keeps every bit."""
    return json.loads(json.dumps(msgspec.to_builtins(value, enc_hook=lambda array: array.tolist())))


def encode(contract: PolicyContract) -> str:
    """Return one line of JSON from which `decode` makes the same contract again, bit for bit."""
    document = plain(contract)
    return json.dumps({"version": _VERSION, "source": document.pop("source"), "contract": document})


def decode(text: str, where: str) -> PolicyContract:
    """Return the contract in a text of `encode`, sources included."""
    with blaming(f"{where}: contract", (ValueError, KeyError, TypeError)):
        document = json.loads(text)
        if document["version"] != _VERSION:
            raise ValueError(f"has version {document['version']!r}, expected {_VERSION}")
        stated = flattened(document["contract"], f"{where}: contract")
        # In older stamps, without a meaning of their own.
        stated = {name: value for name, value in stated.items() if name.split(".")[-1] not in ("topic", "speed")}
        if stated.get("action_limit", 0.0) is None:  # in older stamps: the usual one
            del stated["action_limit"]
        values = {name: checked(name, value, f"{where}: contract: {name}") for name, value in stated.items()}
        return build(values, document["source"])


def read_stamp(metadata: Mapping[str, str], where: str) -> list[Layer]:
    """Return a stamped contract, whose fields keep the sources that they had; usual values have none."""
    if STAMP_KEY not in metadata:
        return []
    made = decode(metadata[STAMP_KEY], where)
    required = [item.name for item in fields(PolicyContract) if item.default is item.default_factory is MISSING]
    phase = None if made.phase is None else PhaseRule(made.phase.period)
    given = {name: getattr(made, name) for name in (*required, "lookahead_steps")}
    usual = flattened(plain(PolicyContract(**{**given, "observation": made.observation_names, "phase": phase})), where)
    layers: dict[str, dict[str, Any]] = {}
    for name, value in flattened(plain(made), where).items():
        is_stated = value and (name in (*given, "phase.period") or name.endswith(".scan"))
        origin = made.source.get(name, "stamp" if is_stated or value != usual.get(name) else "")
        if origin and not origin.startswith("follows from"):
            layers.setdefault(origin, {})[name] = value
    return [Layer(origin, group) for origin, group in layers.items()]


def own_contract(checkpoint: Path) -> Path:
    """Return where a checkpoint's contract belongs: `<checkpoint's stem>.contract.yaml` in its folder."""
    return checkpoint.with_name(f"{checkpoint.stem}.contract.yaml")


def find_contract(checkpoint: Path) -> Path | None:
    """Return `<checkpoint's stem>.contract.yaml`, or else `contract.yaml`, or `.yml`; None without one."""
    places = (own_contract(checkpoint), checkpoint.with_name("contract.yaml"))
    spelled = [path.with_suffix(suffix) for path in places for suffix in (".yaml", ".yml")]
    return next((path for path in spelled if os.path.isfile(path)), None)


def read_contract_file(path: Path) -> Layer:
    """Return what a person wrote about a checkpoint: any field, which decides between all other sources."""
    return Layer(path.name, flattened(read_yaml(path), str(path)), is_decisive=True)


def flattened(document: Any, where: str) -> dict[str, Any]:
    """Return the fields of a contract in JSON or YAML, as in `Layer.values`."""
    known = [*(item.name for item in fields(PolicyContract)), "terms"]
    found: dict[str, Any] = {}
    for name, value in Section(document, where).items():
        options: Mapping[str, Any] = {}
        if name not in known:
            raise InputError(f"{where}: {known_names('field', str(name), known)}")
        if name == "terms":
            options = Section(value, f"{where}: terms")
        elif name == "observation" and isinstance(value, list):
            found[name] = [term.get("name") if isinstance(term, dict) else term for term in value]
            options = {str(term.get("name")): term for term in value if isinstance(term, dict)}
        elif name in ("phase", "tensors") and value is not None:
            found |= {f"{name}.{part}": item for part, item in Section(value, f"{where}: {name}").items()}
        elif name == "command_ranges" and isinstance(value, dict):
            found[name] = [value.get(axis) for axis in COMMAND_AXES]
        elif name != "source":
            found[name] = value
        for term, values in options.items():
            given = Section(values, f"{where}: term {term}").items()
            found |= {f"observation.{term}.{option}": item for option, item in given if option != "name"}
    return found
