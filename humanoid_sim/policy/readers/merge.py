"""Join what the sources say into one contract, or say what is missing and what contradicts what."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from humanoid_sim.controllers.contract import FORMS, PhaseRule, PolicyContract, TensorNames
from humanoid_sim.controllers.terms import Term
from humanoid_sim.errors import FieldError, InputError, known_names, one_line
from humanoid_sim.policy.readers.agreement import Kinds, agreed, contradiction
from humanoid_sim.policy.readers.complete import IncompleteContractError, UnnamedJointsError, complete, missing_fields
from humanoid_sim.policy.readers.partial import NOT_STATED, Given, PartialContract

_OPTIONS = frozenset(field.name for field in fields(Term)) - {"name"}


def merge(
    partials: Sequence[PartialContract], where: str, robot_joints: tuple[str, ...] | None = None
) -> PolicyContract:
    """One contract from what several sources say about it.

    Args:
        partials: in the order in which they are to be named; those that override last.
        robot_joints: the joints in the robot's own order, for a source that gives places instead of names.

    Raises:
        IncompleteContractError: if a field is missing; it holds those that are known.
        InputError: if two sources contradict each other, or if the whole does not fit together.
    """
    try:
        kinds = Kinds.told(partials)
        known = _join_fields(partials, kinds)
        terms = _join_terms(partials, known, kinds)
        complete(known, terms, robot_joints)
    except UnnamedJointsError as error:
        raise UnnamedJointsError(error.count, f"{where}: {error}") from None
    except FieldError as error:
        raise InputError(f"{where}: {one_line(str(error))}") from None
    missing = missing_fields(known, terms)
    if missing:
        read = "; ".join(f"{partial.source} ({', '.join(partial.fields)})" for partial in partials if partial.fields)
        raise IncompleteContractError(
            f"{where}: the contract lacks {', '.join(missing)}; read: {read or 'no source'}; "
            f"give what is missing in {Path(where).stem}.contract.yaml",
            tuple(missing),
            known,
            terms,
        )
    return build_contract(known, terms, where)


def _join_fields(partials: Sequence[PartialContract], kinds: Kinds) -> dict[str, Given]:
    """Every field by its name. One that a source overrides is not compared: the override decides between the others."""
    decided = {name: given for partial in partials if partial.overrides for name, given in partial.fields.items()}
    known = dict(decided)
    for partial in partials:
        for name, given in partial.fields.items():
            if not any(_same_structure(name, other) for other in decided):
                known[name] = _join(name, known[name], given, kinds) if name in known else given
    part = next((name for name in known if name.startswith("phase.")), None)
    if part is not None and "phase" in known:
        raise FieldError(contradiction("phase", known["phase"], known[part], kinds))
    for partial in partials:
        for name, given in partial.assumed.items():
            if not any(_same_structure(name, other) for other in known):
                known[name] = given
    return known


def _same_structure(name: str, other: str) -> bool:
    """Tell whether the two exclude each other: the same field, or a whole (`phase: null`) and a part of it."""
    return name == other or name.startswith(f"{other}.") or other.startswith(f"{name}.")


def _join(field: str, first: Given, second: Given, kinds: Kinds) -> Given:
    both = agreed(field.rpartition(".")[2], first, second, kinds)
    if both is None:
        raise FieldError(contradiction(field, first, second, kinds))
    return both


def _join_terms(
    partials: Sequence[PartialContract], known: Mapping[str, Given], kinds: Kinds
) -> dict[str, dict[str, Given]]:
    """Return the options of every term of the observation, by its name there."""
    names: tuple[str, ...] = known["observation"].value if "observation" in known else ()
    joined: dict[str, dict[str, Given]] = {name: {} for name in names}
    decided: set[tuple[str, str]] = set()
    # Those that override come first: what they say is not compared.
    for partial in sorted(partials, key=lambda partial: not partial.overrides):
        for stated, options in partial.terms.items():
            name = _term_name(stated, names, kinds)
            if name is None:
                # The options of a term that an override has dropped from the observation go with it.
                if "observation" in partial.fields or not names:
                    continue
                raise FieldError(f"{known_names('observation term', stated, names)} ({partial.source})")
            for option, given in options.items():
                own = joined[name]
                field = f"observation.{name}.{option}"
                if (name, option) not in decided:
                    own[option] = _join(field, own[option], given, kinds) if option in own else given
            if partial.overrides:
                decided |= {(name, option) for option in options}
    for name, options in joined.items():
        for partial in partials:
            for option, given in {**partial.assumed_terms, **partial.assumed_kinds.get(kinds.of(name), {})}.items():
                options.setdefault(option, given)
    return joined


def _term_name(stated: str, names: Iterable[str], kinds: Kinds) -> str | None:
    """Return the name under which the observation has a term; exporters call the same one differently."""
    if stated in names:
        return stated
    same = [name for name in names if kinds.of(name) == kinds.of(stated)]
    return same[0] if len(same) == 1 else None


def build_contract(known: Mapping[str, Given], terms: Mapping[str, Mapping[str, Given]], where: str) -> PolicyContract:
    """Return the contract that has these fields, and knows where they came from.

    Raises `InputError` if a field is missing, or they do not fit together.

    Args:
        known: as in `PartialContract.fields`.
        terms: options of the observation terms, by the names in the observation.
    """
    values: dict[str, Any] = {}
    provenance: dict[str, str] = {}
    parts: dict[str, dict[str, Any]] = {"tensors": {}, "phase": {}}
    for name, given in known.items():
        provenance[name] = given.source
        whole, is_part, part = name.partition(".")
        if is_part:
            parts[whole][part] = given.value
        else:
            values[name] = given.value
    if parts["phase"]:
        pace = known.get("phase.period") or known.get("phase.frequency")
        provenance["phase"] = NOT_STATED if pace is None else pace.source
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
        if parts["phase"]:
            values["phase"] = PhaseRule(**parts["phase"])
        return PolicyContract(**values, tensors=TensorNames(**parts["tensors"]), provenance=provenance)
    except (FieldError, TypeError) as error:
        problem = str(error).removeprefix("PolicyContract.").replace("PhaseRule.", "phase.")
        source = provenance.get(problem.partition(":")[0])
        raise InputError(f"{where}: {one_line(f'{problem} ({source})' if source else problem)}") from None
