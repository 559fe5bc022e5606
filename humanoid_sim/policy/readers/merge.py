"""Join what the sources say into one contract, or say what is missing and what contradicts what.

Two sources agree in whatever words and digits they write; where they do not, the message is their difference.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import FORMS, PhaseRule, PolicyContract, TensorNames
from humanoid_sim.controllers.term_kinds import term_kind
from humanoid_sim.controllers.terms import Term
from humanoid_sim.errors import FieldError, InputError, known_names, one_line
from humanoid_sim.policy.readers.complete import IncompleteContractError, UnnamedJointsError, complete, missing_fields
from humanoid_sim.policy.readers.partial import NOT_STATED, Given, PartialContract
from humanoid_sim.policy.readers.values import shown

_OPTIONS = frozenset(option.name for option in fields(Term)) - {"name"}
_EQUAL = 1e-9
"""Relative. What is left of a number that was written with nine digits, or went through a float32 and back, does not
count; gains and scales that mean something else differ by far more."""
_EXPORTERS_DECIMALS = 3
"""From this many decimals on, a copy that equals the other number rounded to them is a rounded copy."""


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


@dataclass(frozen=True, slots=True)
class Kinds:
    """Meaning of the names of terms, as all sources together say."""

    stated: Mapping[str, str] = field(default_factory=dict)
    """By the name of the term, its option `kind`."""
    commands: tuple[str, ...] = ()
    """The contract's `command_names`."""

    @classmethod
    def told(cls, partials: Iterable[PartialContract]) -> Kinds:
        """Return what the sources say; of those that contradict each other the one that overrides, or else the last."""
        stated: dict[str, str] = {}
        commands: tuple[str, ...] = ()
        for partial in sorted(partials, key=lambda partial: partial.overrides):
            stated |= {name: options["kind"].value for name, options in partial.terms.items() if "kind" in options}
            if "command_names" in partial.fields:
                commands = partial.fields["command_names"].value
        return cls(stated, commands)

    def of(self, name: str) -> str:
        """Name of the kind of a term."""
        return term_kind(self.stated.get(name, name), self.commands).name


_BY_NAME = Kinds()


def agreed(field: str, first: Given, second: Given, kinds: Kinds = _BY_NAME) -> Given | None:
    """Return the value that both sources stand for; None if they contradict each other.

    Numbers agree if they are equal, or if one is the other rounded to the digits with which its source writes it. Then
    the more precise one is taken, and its source says so. A copy of fewer than three decimals counts as rounded only if
    it still has two significant digits: 40.2 for 40.179, but not 0.2 for 0.25.
    """
    if field == "observation":
        return first if list(map(kinds.of, first.value)) == list(map(kinds.of, second.value)) else None
    if field == "command_names":
        return first if _commands(first.value) == _commands(second.value) else None
    if _is_numeric(first.value) and _is_numeric(second.value):
        return _agreed_numbers(first, second)
    return first if _same(first.value, second.value) else None


def _agreed_numbers(first: Given, second: Given) -> Given | None:
    a, b = np.asarray(first.value, dtype=np.float64), np.asarray(second.value, dtype=np.float64)
    if a.shape != b.shape and 1 not in (a.size, b.size):
        return None
    longer = first if a.size >= b.size else second
    if np.allclose(a, b, rtol=_EQUAL, atol=0.0):
        return longer
    coarse, fine = sorted((first, second), key=_decimals)
    if _is_rounded(coarse, fine):
        value = np.broadcast_to(fine.value, np.broadcast_shapes(a.shape, b.shape))
        return Given(value if value.ndim else float(value), f"{fine.source} ({coarse.source} has it rounded)")
    return None


def _commands(names: tuple[str, ...]) -> list[str]:
    return sorted({"motion" if name == "motion" else "velocity" for name in names})


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


def contradiction(name: str, first: Given, second: Given, kinds: Kinds = _BY_NAME) -> str:
    """Return what two sources say of a field, as far as it differs, and what to do about it."""
    a, b = first.value, second.value
    if _are_names(a) and _are_names(b):
        what = _different_names(first, second, kinds.of if name == "observation" else str)
    else:
        if isinstance(a, np.ndarray) and isinstance(b, np.ndarray) and a.shape == b.shape and a.ndim:
            place = next(tuple(map(int, i)) for i in np.argwhere(~np.isclose(a, b, rtol=_EQUAL, atol=0.0)))
            name += "".join(f"[{i}]" for i in place)
            a, b = float(a[place]), float(b[place])
        what = f"{shown(a)} in {first.source} contradicts {shown(b)} in {second.source}"
    return (
        f"{name}: {what}; if one of them is wrong, write the right one under override: in x.contract.yaml, "
        "or leave out a source that is wrong as a whole with ignore:"
    )


def _are_names(value: Any) -> bool:
    return isinstance(value, tuple) and all(isinstance(item, str) for item in value)


def _different_names(first: Given, second: Given, meaning: Callable[[str], str]) -> str:
    """Give the names that only one of two lists has; where both have the same, the first place at which they differ."""
    sides = ((first, second), (second, first))
    parts = [
        f"{', '.join(surplus)} only in {one.source}"
        for one, other in sides
        if (surplus := _surplus(one.value, other.value, meaning))
    ]
    if parts:
        return "; ".join(parts)
    place = next(i for i, (a, b) in enumerate(zip(first.value, second.value, strict=True)) if meaning(a) != meaning(b))
    return (
        f"the order differs: at place {place} {first.value[place]} in {first.source} "
        f"contradicts {second.value[place]} in {second.source}"
    )


def _surplus(names: Sequence[str], others: Sequence[str], meaning: Callable[[str], str]) -> list[str]:
    left = list(map(meaning, others))
    surplus = []
    for name in names:
        if meaning(name) in left:
            left.remove(meaning(name))
        else:
            surplus.append(name)
    return surplus
