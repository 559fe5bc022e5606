"""A complete contract as JSON, bit for bit: for recordings, and for checkpoints that carry theirs with them."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import FORMS, PhaseRule, PolicyContract, TensorNames
from humanoid_sim.controllers.terms import Term
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.policy.readers.contract_yaml import COMMAND_AXES, parse_contract
from humanoid_sim.policy.readers.merge import build_contract
from humanoid_sim.policy.readers.partial import NOT_STATED, Given, PartialContract, is_assumed, is_stated

STAMP_KEY = "humanoid_sim_contract"
"""Metadata key under which a stamped checkpoint carries its contract."""

_VERSION = 1
STAMP_SOURCE = "stamp"


def encode(contract: PolicyContract) -> str:
    """One line of JSON from which `decode` makes the same contract again.

    It is what a contract.yaml that gives every field would say, with `version` and `provenance` beside. A bound that is
    infinite is written as Python's `Infinity`, everything else as plain JSON.
    """
    document: dict[str, Any] = {"version": _VERSION}
    for name, form in FORMS.items():
        value = getattr(contract, name)
        if form.kind != "limit" or value is None or math.isfinite(value):
            document[name] = plain_value(name, value)
    return json.dumps({**document, "provenance": dict(contract.provenance)})


def plain_value(name: str, value: Any) -> Any:
    """Return a field of a contract, or an option of a term, as a contract.yaml has it."""
    if name in FORMS and FORMS[name].kind == "axes" and value is not None:
        return dict(zip(COMMAND_AXES, value.tolist(), strict=True))
    return _plain(value)


def decode(text: str, where: str) -> PolicyContract:
    """Return the contract in a text of `encode`, provenance included."""
    with blaming(f"{where}: contract is not JSON", ValueError):
        document = json.loads(text)
    if not isinstance(document, dict):
        raise InputError(f"{where}: contract is a {type(document).__name__}, expected a JSON object")
    version = document.pop("version", None)
    if version != _VERSION:
        raise InputError(f"{where}: contract has version {version!r}, expected {_VERSION}")
    provenance = document.pop("provenance", {})
    if not isinstance(provenance, dict) or not all(isinstance(source, str) for source in provenance.values()):
        raise InputError(f"{where}: provenance is {provenance!r}, expected a mapping from fields to texts")
    stated, *surplus = parse_contract(document, where, STAMP_SOURCE)
    if surplus or stated.ignores:
        raise InputError(f"{where}: contract has overrides or sources to ignore, expected its fields alone")
    return replace(build_contract(stated.fields, stated.terms, where), provenance=provenance)


def read_stamp(text: str, where: str) -> PartialContract:
    """Return a stamped contract as one source among others; what its fields came from is kept.

    What nobody stated when it was stamped is not stated now either: another source may still say otherwise.
    """
    contract = decode(text, where)
    stated: dict[str, Given] = {}
    assumed: dict[str, Given] = {}
    for name, value in _fields(contract):
        origin = _origin(contract, name)
        if name.startswith("phase.") and origin == NOT_STATED:
            continue  # the clock has it by itself
        (stated if is_stated(origin) else assumed)[name] = Given(value, origin)
    terms: dict[str, dict[str, Given]] = {}
    assumed_kinds: dict[str, dict[str, Given]] = {}
    for term in contract.terms:
        terms[term.name] = {}
        usual = Term(term.name)
        for field in fields(Term):
            value, prefix = getattr(term, field.name), f"observation.{term.name}."
            origin = contract.provenance.get(prefix + field.name, "")
            if is_assumed(origin):
                assumed_kinds.setdefault(contract.kind(term).name, {})[field.name] = Given(value, origin)
            elif origin or _plain(value) != _plain(getattr(usual, field.name)):
                terms[term.name][field.name] = Given(value, origin or STAMP_SOURCE)
    return PartialContract(STAMP_SOURCE, stated, terms, assumed, assumed_kinds=assumed_kinds)


def _origin(contract: PolicyContract, name: str) -> str:
    """Return where a field is from; a clock that was stamped as a whole is from one source."""
    whole = contract.provenance.get("phase", STAMP_SOURCE) if name.startswith("phase.") else STAMP_SOURCE
    is_apart = name.startswith("phase.") and any(field.startswith("phase.") for field in contract.provenance)
    return contract.provenance.get(name, NOT_STATED if is_apart else whole)


def _fields(contract: PolicyContract) -> Iterator[tuple[str, Any]]:
    """Yield the fields as sources give them: names of terms alone, tensors one by one."""
    for name in FORMS:
        if name == "phase" and contract.phase is not None:
            for field in fields(PhaseRule):
                yield f"phase.{field.name}", getattr(contract.phase, field.name)
        elif name != "tensors":
            yield name, contract.observation_names if name == "observation" else getattr(contract, name)
    for field in fields(TensorNames):
        value, name = getattr(contract.tensors, field.name), f"tensors.{field.name}"
        if value or name in contract.provenance:
            yield name, value


def _plain(value: Any) -> Any:
    """Arrays as lists, structs as objects; JSON keeps a float64's repr, and with it every bit."""
    if isinstance(value, Term | PhaseRule | TensorNames):
        plain = {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
        # In the schema a term that shows all joints, or whose positions are as usual, leaves the option out.
        return {name: item for name, item in plain.items() if item is not None or name == "standing_value"}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return value
