"""A complete contract as JSON, bit for bit: for recordings, and for checkpoints that carry theirs with them."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract, TensorNames
from humanoid_sim.controllers.phase import PhaseRule
from humanoid_sim.controllers.terms import Term
from humanoid_sim.errors import FieldError, InputError, known_names
from humanoid_sim.policy.readers.partial import Given, PartialContract

__all__ = ["STAMP_KEY", "decode", "encode", "read_stamp"]

STAMP_KEY = "humanoid_sim_contract"
"""Metadata key under which a stamped checkpoint carries its contract."""

_VERSION = 1
_SOURCE = "stamp"
_UNSTATED = ("assumed", "default", "follows from")
"""Beginnings of the sources of what no source stated."""


def encode(contract: PolicyContract) -> str:
    """One line of JSON from which `decode` makes the same contract again, provenance included."""
    document = {"version": _VERSION, **_plain(contract)}
    return json.dumps(document, allow_nan=False)


def decode(text: str, where: str) -> PolicyContract:
    """The contract in a text of `encode`.

    Raises:
        InputError: naming `where`, if it is none.
    """
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: contract is no JSON: {error}") from None
    if not isinstance(document, dict):
        raise InputError(f"{where}: contract is a {type(document).__name__}, expected a JSON object")
    version = document.pop("version", None)
    if version != _VERSION:
        raise InputError(f"{where}: contract has version {version!r}, expected {_VERSION}")
    try:
        return _contract(document)
    except FieldError as error:
        raise InputError(f"{where}: {str(error).removeprefix('PolicyContract.')}") from None
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(f"{where}: contract is malformed: {error}") from None


def read_stamp(text: str, where: str) -> PartialContract:
    """A stamped contract as one source among others; what its fields came from is kept.

    What nobody stated when it was stamped is not stated now either: another source may still say otherwise.
    """
    contract = decode(text, where)
    stated: dict[str, Given] = {}
    assumed: dict[str, Given] = {}
    for name, value in _fields(contract):
        origin = contract.provenance.get(name, _SOURCE)
        (assumed if origin.startswith(_UNSTATED) else stated)[name] = Given(value, origin)
    terms: dict[str, dict[str, Given]] = {}
    assumed_terms: dict[str, Given] = {}
    for term in contract.terms:
        terms[term.name] = {}
        usual = Term(term.name)
        for field in fields(Term):
            value, prefix = getattr(term, field.name), f"observation.{term.name}."
            origin = contract.provenance.get(prefix + field.name, "")
            if origin.startswith("assumed"):
                assumed_terms[field.name] = Given(value, origin)
            elif origin or _plain(value) != _plain(getattr(usual, field.name)):
                terms[term.name][field.name] = Given(value, origin or _SOURCE)
    return PartialContract(_SOURCE, stated, terms, assumed, assumed_terms)


def _fields(contract: PolicyContract) -> Iterator[tuple[str, Any]]:
    """The fields as sources give them: names of terms alone, tensors one by one."""
    for field in fields(PolicyContract):
        if field.name == "observation":
            yield field.name, contract.observation_names
        elif field.name not in ("provenance", "tensors"):
            yield field.name, getattr(contract, field.name)
    for field in fields(TensorNames):
        value, name = getattr(contract.tensors, field.name), f"tensors.{field.name}"
        if value or name in contract.provenance:
            yield name, value


def _plain(value: Any) -> Any:
    """Arrays as lists, structs and mappings as objects; JSON keeps a float64's repr, and with it every bit."""
    if isinstance(value, PolicyContract | Term | PhaseRule | TensorNames):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return repr(value)  # JSON has no infinity
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return value


def _contract(document: dict[str, Any]) -> PolicyContract:
    known = [field.name for field in fields(PolicyContract)]
    for name in document:
        if name not in known:
            raise FieldError(known_names("field", name, known))
    values = dict(document)
    values["action_clip"] = float(document.get("action_clip", math.inf))
    for name in ("command_ranges", "position_clip"):
        if document.get(name) is not None:
            values[name] = [[float(bound) for bound in row] for row in document[name]]
    values["observation"] = [_term(term) for term in document.get("observation", [])]
    if document.get("phase") is not None:
        values["phase"] = PhaseRule(**document["phase"])
    values["tensors"] = TensorNames(**document.get("tensors", {}))
    for name in ("joint_names", "action_joint_names", "command_names", "body_names"):
        if not isinstance(values.get(name), list):
            raise FieldError(f"{name}: is {values.get(name)!r}, expected a list of names")
    return PolicyContract(**values)


def _term(document: Any) -> Term:
    values = dict(document)
    if values.get("clip") is not None:
        values["clip"] = tuple(float(bound) for bound in values["clip"])
    return Term(**values)
