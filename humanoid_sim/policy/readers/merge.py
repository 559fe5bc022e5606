"""Join what the sources say into one contract, or say what is missing and what contradicts what."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract, TensorNames
from humanoid_sim.controllers.terms import Term
from humanoid_sim.errors import FieldError, InputError, known_names
from humanoid_sim.policy.readers.agree import agreed, kind_of
from humanoid_sim.policy.readers.complete import complete, missing_fields
from humanoid_sim.policy.readers.partial import Given, PartialContract
from humanoid_sim.policy.readers.texts import one_line, shown

__all__ = ["build_contract", "merge"]

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
        complete(known, terms, robot_joints, [partial.source for partial in partials])
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
    same = [name for name in names if kind_of(name) == kind_of(stated)]
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
    for field in fields(PolicyContract):
        if field.name not in ("provenance", "tensors"):
            provenance.setdefault(field.name, "default")
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
