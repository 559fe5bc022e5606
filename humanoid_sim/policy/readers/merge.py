"""Join what the sources say into one contract, or say what is missing and what contradicts what."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import FORMS, PolicyContract, TensorNames
from humanoid_sim.controllers.term_kinds import term_kind
from humanoid_sim.controllers.terms import Term
from humanoid_sim.errors import FieldError, InputError, known_names, one_line
from humanoid_sim.policy.readers.complete import complete, missing_fields
from humanoid_sim.policy.readers.partial import NOT_STATED, Given, PartialContract
from humanoid_sim.policy.readers.values import shown

__all__ = ["agreed", "build_contract", "merge"]


_OPTIONS = frozenset(field.name for field in fields(Term)) - {"name"}


def merge(
    partials: Sequence[PartialContract], where: str, robot_joints: tuple[str, ...] | None = None
) -> PolicyContract:
    """One contract from what several sources say about it.

    Args:
        partials: in the order in which they are to be named; those that override last.
        where: what to call the checkpoint in messages.
        robot_joints: the joints in the robot's own order, for a source that gives places instead of names.

    Raises:
        InputError: if two sources contradict each other, if a field is missing, or if the whole does not fit together.
    """
    try:
        known = _join_fields(partials)
        terms = _join_terms(partials, known)
        complete(known, terms, robot_joints)
    except FieldError as error:
        raise InputError(f"{where}: {one_line(str(error))}") from None
    missing = missing_fields(known, terms)
    if missing:
        read = "; ".join(f"{partial.source} ({', '.join(partial.fields)})" for partial in partials if partial.fields)
        raise InputError(
            f"{where}: the contract lacks {', '.join(missing)}; read: {read or 'no source'}; "
            "give what is missing in a contract.yaml"
        )
    return build_contract(known, terms, where)


def _join_fields(partials: Sequence[PartialContract]) -> dict[str, Given]:
    known: dict[str, Given] = {}
    for partial in partials:
        for name, given in partial.fields.items():
            known[name] = given if partial.overrides or name not in known else _join(name, known[name], given)
    for partial in partials:
        for name, given in partial.assumed.items():
            known.setdefault(name, given)
    return known


def _join(field: str, first: Given, second: Given) -> Given:
    both = agreed(field.rpartition(".")[2], first, second)
    if both is None:
        raise FieldError(_conflict(field, first, second))
    return both


def _conflict(field: str, first: Given, second: Given) -> str:
    a, b = first.value, second.value
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray) and a.shape == b.shape and a.ndim:
        place = next(tuple(map(int, i)) for i in np.argwhere(~np.isclose(a, b, rtol=1e-9, atol=0.0)))
        field += "".join(f"[{i}]" for i in place)
        a, b = float(a[place]), float(b[place])
    return (
        f"{field}: {shown(a)} in {first.source} contradicts {shown(b)} in {second.source}; "
        "if one of them is wrong, write the right one under override: in a contract.yaml"
    )


def _join_terms(partials: Sequence[PartialContract], known: Mapping[str, Given]) -> dict[str, dict[str, Given]]:
    """The options of every term of the observation, by its name there."""
    names: tuple[str, ...] = known["observation"].value if "observation" in known else ()
    joined: dict[str, dict[str, Given]] = {name: {} for name in names}
    for partial in partials:
        for stated, options in partial.terms.items():
            name = _term_name(stated, names)
            if name is None:
                # The options of a term that an override has dropped from the observation go with it.
                if "observation" in partial.fields or not names:
                    continue
                raise FieldError(f"{known_names('observation term', stated, names)} ({partial.source})")
            for option, given in options.items():
                own = joined[name]
                field = f"observation.{name}.{option}"
                own[option] = given if partial.overrides or option not in own else _join(field, own[option], given)
    for options in joined.values():
        for partial in partials:
            for option, given in partial.assumed_terms.items():
                options.setdefault(option, given)
    return joined


def _term_name(stated: str, names: Iterable[str]) -> str | None:
    """The name under which the observation has a term; exporters call the same one differently."""
    if stated in names:
        return stated
    same = [name for name in names if term_kind(name).name == term_kind(stated).name]
    return same[0] if len(same) == 1 else None


def build_contract(known: Mapping[str, Given], terms: Mapping[str, Mapping[str, Given]], where: str) -> PolicyContract:
    """The contract that has these fields, and knows where they came from.

    Args:
        known: as in `PartialContract.fields`.
        terms: options of the observation terms, by the names in the observation.
        where: what to call it in messages.

    Raises:
        InputError: if a field is missing, or they do not fit together.
    """
    values: dict[str, Any] = {}
    provenance: dict[str, str] = {}
    tensors: dict[str, str] = {}
    for name, given in known.items():
        provenance[name] = given.source
        if name.startswith("tensors."):
            tensors[name.removeprefix("tensors.")] = given.value
        else:
            values[name] = given.value
    for name in FORMS:
        if name != "tensors":
            provenance.setdefault(name, NOT_STATED)
    for name, options in terms.items():
        provenance |= {f"observation.{name}.{option}": given.source for option, given in options.items()}
    try:
        values["observation"] = [
            Term(name, **{option: given.value for option, given in terms.get(name, {}).items() if option in _OPTIONS})
            for name in values.get("observation", ())
        ]
        return PolicyContract(**values, tensors=TensorNames(**tensors), provenance=provenance)
    except (FieldError, TypeError) as error:
        raise InputError(f"{where}: {one_line(_with_source(str(error), provenance))}") from None


def _with_source(problem: str, provenance: Mapping[str, str]) -> str:
    problem = problem.removeprefix("PolicyContract.")
    source = provenance.get(problem.partition(":")[0])
    return f"{problem} ({source})" if source else problem


_EQUAL = 1e-9
"""Relative. What is left of a number that was written with nine digits, or went through a float32 and back, does not
count; gains and scales that mean something else differ by far more."""
_EXPORTERS_DECIMALS = 3
"""From this many decimals on, a copy that equals the other number rounded to them is a rounded copy."""


def agreed(field: str, first: Given, second: Given) -> Given | None:
    """The value that both sources stand for; None if they contradict each other.

    Numbers agree if they are equal, or if one is the other rounded to the digits with which its source writes it. Then
    the more precise one is taken, and its source says so. A copy of fewer than three decimals counts as rounded only if
    it still has two significant digits: 40.2 for 40.179, but not 0.2 for 0.25.
    """
    if field in _BY_MEANING:
        meaning = _BY_MEANING[field]
        return first if meaning(first.value) == meaning(second.value) else None
    if _is_numeric(first.value) and _is_numeric(second.value):
        return _agreed_numbers(first, second)
    return first if _same(first.value, second.value) else None


def _agreed_numbers(first: Given, second: Given) -> Given | None:
    a, b = np.asarray(first.value, dtype=np.float64), np.asarray(second.value, dtype=np.float64)
    if a.shape != b.shape and a.size > 1 and b.size > 1:
        return None
    longer = first if a.size >= b.size else second
    if np.allclose(a, b, rtol=_EQUAL, atol=0.0):
        return longer
    coarse, fine = sorted((first, second), key=_decimals)
    if _is_rounded(coarse, fine):
        value = np.broadcast_to(fine.value, np.broadcast_shapes(a.shape, b.shape))
        return Given(value if value.ndim else float(value), f"{fine.source} ({coarse.source} has it rounded)")
    return None


def _kinds(names: tuple[str, ...]) -> list[str]:
    return [term_kind(name).name for name in names]


def _commands(names: tuple[str, ...]) -> list[str]:
    return sorted({"motion" if name == "motion" else "velocity" for name in names})


_BY_MEANING = {"observation": _kinds, "command_names": _commands}
"""Fields whose names may differ between exporters, and what has to be the same."""


def _is_numeric(value: Any) -> bool:
    return (isinstance(value, int | float) and not isinstance(value, bool)) or (
        isinstance(value, np.ndarray) and value.dtype.kind in "fiu"
    )


def _same(a: Any, b: Any) -> bool:
    if is_dataclass(a) and is_dataclass(b):
        return all(_same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(_same(x, y) for x, y in zip(a, b, strict=True))
    if _is_numeric(a) and _is_numeric(b):
        return np.shape(a) == np.shape(b) and bool(np.allclose(a, b, rtol=_EQUAL, atol=0.0))
    return type(a) is type(b) and bool(a == b)


def _is_rounded(coarse: Given, fine: Given) -> bool:
    values = np.atleast_1d(np.asarray(coarse.value, dtype=np.float64))
    decimals = _decimals(coarse)
    if decimals < 1 or not np.isfinite(values).all():
        return False
    if decimals < _EXPORTERS_DECIMALS and np.abs(values).max() * 10**decimals < 10:
        return False
    # The place after the last one decides by its half; a float's own error must not.
    return bool((np.abs(values - fine.value) <= 0.5 * 10.0**-decimals + 1e-12).all())


def _decimals(given: Given) -> int:
    if given.decimals is not None:
        return given.decimals
    values = np.asarray(given.value, dtype=np.float64).ravel()
    texts = [np.format_float_positional(value, trim="-") for value in values if np.isfinite(value)] or [""]
    return max(len(text.partition(".")[2]) for text in texts)
