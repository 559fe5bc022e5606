"""`contract.yaml`: any field of a contract, written by hand; under `override:` also against what other sources say.

The schema follows from the annotations of `PolicyContract` and `Term`; `docs/contract.md` explains it with examples.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, get_type_hints

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType

from humanoid_sim.controllers.contract import FORMS, Form, PhaseRule, TensorNames
from humanoid_sim.controllers.terms import Term
from humanoid_sim.errors import FieldError, InputError, one_line
from humanoid_sim.files import is_file
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.readers.partial import Given, PartialContract
from humanoid_sim.strict_yaml import read_yaml, schema_problem

CONTRACT_FILE = "contract.yaml"
COMMAND_AXES = ("lin_vel_x", "lin_vel_y", "ang_vel_z")
"""Axes of the velocity command, in the order of a contract's `command_ranges`."""

Numbers = float | list[float]
"""One number for all, or one each."""
Pair = tuple[float, float]
_Field = tuple[str, Any] | tuple[str, Any, Any]


def _struct(name: str, *members: _Field, base: type[msgspec.Struct] = msgspec.Struct) -> type[msgspec.Struct]:
    return msgspec.defstruct(name, members, bases=(base,), frozen=True, kw_only=True, forbid_unknown_fields=True)


def _members(owner: type) -> list[_Field]:
    """Return the fields of a dataclass as YAML has them; those with a default may be left out."""
    hints = get_type_hints(owner)
    plain = {
        FloatArray: list[float],
        FloatArray | float: Numbers,
        FloatArray | None: list[Pair] | None,
        bool | None: bool,
        int | None: int,
        tuple[str, ...] | None: list[str],
    }
    members: list[_Field] = []
    for field in dataclasses.fields(owner):
        kind = plain.get(hints[field.name], hints[field.name])
        has_default = not field.default is field.default_factory is dataclasses.MISSING
        members.append((field.name, kind | UnsetType, UNSET) if has_default else (field.name, kind))
    return members


_COMMAND = _struct("CommandRangeFields", *((axis, Pair) for axis in COMMAND_AXES))
_PHASE, _TENSORS = _struct("PhaseFields", *_members(PhaseRule)), _struct("TensorFields", *_members(TensorNames))
TermOptions = _struct("TermOptions", *(member for member in _members(Term) if member[0] != "name"))
"""Options of one observation term; the meaning of each is in `controllers.terms.Term`."""
_TERM: Any = _struct("TermFields", ("name", str), base=TermOptions)

_TYPES: dict[str, Any] = {
    "names": list[str],
    "text": str,
    "flag": bool,
    "number": float,
    "limit": float,
    "values": Numbers,
    "limits": Numbers | dict[str, float],
    "pairs": list[Pair],
    "steps": list[int],
    "axes": _COMMAND,
}
"""YAML types for each form of a field."""
_STRUCTURES: dict[str, Any] = {"observation": list[str | _TERM], "phase": _PHASE | None, "tensors": _TENSORS}


def _type(name: str, form: Form) -> Any:
    if form.kind == "choice":
        return Literal[form.choices]
    if form.kind == "structure":
        return _STRUCTURES[name]
    words = tuple(word for word in form.instead if word is not None)
    accepted = _TYPES[form.kind] | Literal[words] if words else _TYPES[form.kind]
    return accepted | None if None in form.instead else accepted


ContractFields = _struct(
    "ContractFields",
    *((name, _type(name, form) | UnsetType, UNSET) for name, form in FORMS.items()),
    # Each one `TermOptions`, converted by itself: msgspec does not name the key at which something is wrong.
    ("terms", dict[str, dict[str, Any]] | UnsetType, UNSET),
)
"""Every field of a `PolicyContract`, each of which may be left out."""
ContractFile = _struct(
    "ContractFile",
    ("override", ContractFields | UnsetType, UNSET),
    ("ignore", list[str] | UnsetType, UNSET),
    base=ContractFields,
)
"""A whole file: fields that have to agree with the other sources, fields that override them, sources to leave out."""


def own_contract(checkpoint: Path) -> Path:
    """Return where a checkpoint's contract belongs: `<checkpoint's stem>.contract.yaml` in its folder."""
    return checkpoint.with_name(f"{checkpoint.stem}.{CONTRACT_FILE}")


def find_contract(checkpoint: Path) -> Path | None:
    """`<checkpoint's stem>.contract.yaml`, or else `contract.yaml`, in the checkpoint's folder; None without one."""
    places = (own_contract(checkpoint), checkpoint.with_name(CONTRACT_FILE))
    return next((place for place in places if is_file(place)), None)


def read_contract_file(path: Path) -> list[PartialContract]:
    """Return the file's own fields and, if it has any, its overrides."""
    return parse_contract(read_yaml(path), str(path), path.name)


def parse_contract(document: Any, where: str, source: str) -> list[PartialContract]:
    """Return the same of a document that has been read already.

    Args:
        where: what to call the file in messages.
        source: what to call it in the contract's provenance.
    """
    file = dict(_set_fields(_convert({} if document is None else document, ContractFile, where, "")))
    override, ignored = file.pop("override", None), tuple(file.pop("ignore", ()))
    partials = [replace(_partial(file, where, source, overrides=False), ignores=ignored)]
    if override is not None:
        partials.append(_partial(dict(_set_fields(override)), where, f"{source} override", overrides=True))
    return partials


def _partial(section: dict[str, Any], where: str, source: str, *, overrides: bool) -> PartialContract:
    fields: dict[str, Given] = {}
    terms: dict[str, dict[str, Given]] = {}
    prefix = "override." if overrides else ""
    options_by_term = section.pop("terms", {})
    for name, value in section.items():
        if name in _BY_PART and value is not None:
            parts = {key: _number_or_array(part) for key, part in _set_fields(value)}
            _check_phase(parts if name == "phase" else {}, f"{where}: {prefix}")
            fields |= {f"{name}.{key}": Given(part, source) for key, part in parts.items()}
            continue
        try:
            fields[name] = Given(_value(name, value), source)
        except FieldError as error:
            raise InputError(f"{where}: {prefix}{name}.{str(error).partition('.')[2]}") from None
        if name == "observation":
            terms |= {term.name: _options(term, source) for term in value if not isinstance(term, str)}
    for term_name, document in options_by_term.items():
        options = _convert(document, TermOptions, where, f"{prefix}terms.{term_name}")
        for option, given in _options(options, source).items():
            if option in terms.setdefault(term_name, {}):
                raise InputError(f"{where}: {prefix}terms.{term_name}.{option}: is given in observation as well")
            terms[term_name][option] = given
    return PartialContract(source, fields, terms, overrides=overrides)


_BY_PART = ("tensors", "phase")
"""Structures each field of which may come from another source."""


def _check_phase(parts: dict[str, Any], where: str) -> None:
    """Refuse what no gait clock can have; the period may still come from another source."""
    try:
        PhaseRule(**({} if "frequency" in parts else {"period": 1.0}) | parts)
    except FieldError as error:
        raise InputError(f"{where}phase.{str(error).partition('.')[2]}") from None


def _convert(document: Any, struct: type[msgspec.Struct], where: str, place: str) -> msgspec.Struct:
    """Return a document as a struct; `place` is where in the file it stands."""
    try:
        return msgspec.convert(document, struct)
    except msgspec.ValidationError as error:
        problem = schema_problem(error, document, struct)
        joint = "" if not place else ": " if problem.startswith(("is ", "unknown ", "misses ")) else "."
        raise InputError(f"{where}: {one_line(f'{place}{joint}{problem}')}") from None
    except (OverflowError, RecursionError) as error:
        raise InputError(f"{where}: {error}") from None


def _set_fields(struct: msgspec.Struct) -> Iterator[tuple[str, Any]]:
    for name in struct.__struct_fields__:
        value = getattr(struct, name)
        if value is not UNSET:
            yield name, value


def _options(term: msgspec.Struct, source: str) -> dict[str, Given]:
    return {
        name: Given(tuple(value) if name == "joints" else _number_or_array(value), source)
        for name, value in _set_fields(term)
        if name != "name"
    }


def _value(name: str, value: Any) -> Any:
    """Return a field as a `PolicyContract` takes it, of the observation the names alone."""
    if value is None or (isinstance(value, str) and value in FORMS[name].instead):
        return value
    if name == "observation":
        return tuple(term if isinstance(term, str) else term.name for term in value)
    match FORMS[name].kind:
        case "axes":
            return np.array([getattr(value, axis) for axis in COMMAND_AXES])
        case "pairs":
            value = np.array(value, dtype=np.float64).reshape(-1, 2)
        case "names" | "steps":
            value = tuple(value)
    return _number_or_array(value)


def _number_or_array(value: Any) -> Any:
    return np.array(value, dtype=np.float64) if isinstance(value, list) else value
