"""Contracts in layers: each source states some fields, and the later source wins.

Order: a dialect's assumptions, the model's metadata, the trainer's files beside it, `x.contract.yaml`. Where two of the
trainer's own sources differ by more than rounding both are named, and `x.contract.yaml` alone decides between them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, get_args, get_type_hints

import msgspec
import numpy as np

from humanoid_sim.controllers.contract import PhaseRule, PolicyContract, TensorNames, Term
from humanoid_sim.controllers.terms import TermKind, term_kind
from humanoid_sim.errors import FieldError, InputError, known_names, one_line
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.findings import list_joints, shown

ROBOTS_ORDER = "robot's own order"
COMMAND_AXES = ("lin_vel_x", "lin_vel_y", "ang_vel_z")  # of a contract's `command_ranges`, in files
REQUIRED = (
    *("joint_names", "joint_stiffness", "joint_damping", "default_joint_pos"),
    *("observation", "action_scale", "policy_dt"),
)
_NEUTRAL: Mapping[str, Any] = {
    **{"joint_stiffness": 1.0, "joint_damping": 1.0, "default_joint_pos": 0.0, "action_scale": 1.0},
    **{"policy_dt": 0.02, "anchor_body": "?", "lookahead_steps": (1,), "phase.period": 1.0},
}
"""In the place of missing values: the observation's width is known all the same."""
_MAY_DIFFER = ("command_ranges", "dataset_repo_id")  # between a trainer and its deployment


class Statement(NamedTuple):
    """A value and where it came from."""

    value: Any
    source: str


@dataclass(frozen=True, slots=True)
class Layer:
    """Statements of one source; one whose name begins with `assumed` comes before everything stated."""

    source: str
    values: Mapping[str, Any]
    """By the contract's field, `phase.PART`, `tensors.PART` or `observation.TERM.OPTION`, as the source writes it.
    `observation` holds names alone. Values for each joint may be a mapping from names or patterns of them; names of
    joints may be places in `joint_names`, a slice of it, or patterns."""
    is_decisive: bool = False  # a person wrote it, to decide between the others
    unused: tuple[str, ...] = ()  # what it has that is not read, a line each


@dataclass(frozen=True, slots=True)
class Reading:
    """All that the sources of a checkpoint state, and what is wrong with it."""

    values: Mapping[str, Any]  # by field, as in `Layer.values`, in the order of the joints
    source: Mapping[str, str]
    replaced: Mapping[str, tuple[Statement, ...]]
    differences: tuple[str, ...]  # between the trainer's own sources, a line for each field
    missing: tuple[str, ...]
    unused: tuple[str, ...]
    problem: str = ""  # why the fields do not make a contract
    outline: PolicyContract | None = None
    """The contract, with something harmless in the place of what is missing; None without terms, or with a problem."""

    @property
    def contract(self) -> PolicyContract | None:
        """None where something is missing, or does not fit."""
        return None if self.missing else self.outline

    def refusal(self, hand: str) -> str:
        """Return all that keeps the contract from being used, as one line; `hand`: the contract.yaml that decides."""
        parts = [*self.differences]
        if parts:
            parts[-1] += f" (the right value in {hand} decides)"
        if self.missing:
            parts.append(f"lacks {', '.join(self.missing)}: give what is missing in {hand}")
        elif self.problem:
            parts.append(self.problem)
        return "; ".join(parts)


def is_assumed(source: str) -> bool:
    """Return True if no source states a field, but a dialect implies it."""
    return source.startswith("assumed")


def join(layers: Iterable[Layer], where: str) -> Reading:
    """Join what several sources of the checkpoint `where` state. Raises `InputError` for a value that cannot be."""
    implied, stating = list[Layer](), list[Layer]()
    for layer in layers:
        (implied if is_assumed(layer.source) or layer.source == ROBOTS_ORDER else stating).append(layer)
    # Of assumptions the first source's count: the model's own metadata knows its dialect best.
    ordered = [*reversed(implied), *stating]
    names = _Names(ordered, where)
    found: dict[str, Statement] = {}
    replaced: dict[str, tuple[Statement, ...]] = {}
    differences: dict[str, str] = {}
    stated = set[str]()
    for layer in ordered:
        for key, value in names.resolved(layer, found, where):
            new = Statement(value, layer.source)
            if key in stated:
                both = _merged(key, found[key], new, names, names.owners(key, found))
                if isinstance(both, Statement):
                    new = both
                else:
                    replaced[key] = (*replaced.get(key, ()), found[key])
                    differences[key] = both
            if layer.is_decisive or key in _MAY_DIFFER:
                differences.pop(key, None)
            if layer in stating:
                stated.add(key)
            if key == "phase":  # null takes away the clock that another source gives part by part
                found = {name: old for name, old in found.items() if not name.startswith("phase.")}
            found[key] = new
    _derive(found)
    values = {name: statement.value for name, statement in found.items()}
    source = {name: statement.source for name, statement in found.items()}
    missing, unused = tuple(_missing(values)), tuple(line for layer in ordered for line in layer.unused)
    old = {key: items for key, items in replaced.items() if key in found}
    reading = Reading(values, source, old, tuple(differences.values()), missing, unused)
    if {"joint_names", "observation"} & set(missing):
        return reading
    lacking = {"phase.period" if name == "phase" else name for name in missing}
    neutral = {name: value for name, value in _NEUTRAL.items() if name in lacking}
    try:
        return replace(reading, outline=build({**neutral, **values}, source))
    except FieldError as error:
        problem = str(error).removeprefix("PolicyContract.").replace("PhaseRule.", "phase.")
        origin = source.get(problem.partition(":")[0])
        return replace(reading, problem=one_line(f"{problem} ({origin})" if origin else problem))


# --- values as sources write them ---

_PER_JOINT = frozenset(
    {"joint_stiffness", "joint_damping", "default_joint_pos", "effort_limit", "command_ranges"}
    | {"action_scale", "action_offset", "position_clip", "scale", "offsets"}
)
_NAMES = frozenset({"joint_names", "body_names", "command_names", "observation", "action_joint_names", "joints"})
_OWNERS = {"": PolicyContract, "phase": PhaseRule, "tensors": TensorNames, "observation": Term}


def checked(name: str, value: Any, where: str) -> Any:
    """Return the value of a field, as `Layer.values` names it, of the right kind.

    Raises `InputError`, which begins with `where`, for an unknown field, or a value of another kind.
    """
    whole, _, part = name.partition(".")
    option = part.rpartition(".")[2] or whole
    types = get_type_hints(_OWNERS[whole if part else ""])
    if option not in types:
        raise InputError(f"{where}: {known_names('field', option, types)}")
    if value is None and type(None) in get_args(types[option]):
        return None
    is_places = isinstance(value, list) and len(value) > 0 and all(type(item) is int for item in value)
    try:
        if option in _PER_JOINT:
            return _numbers(option, value)
        if option in ("action_joint_names", "joints") and (is_places or isinstance(value, slice)):
            return value
        is_names = option in _NAMES and whole != "tensors"
        texts = [value] if is_names and isinstance(value, str) else value
        return msgspec.convert(texts, tuple[str, ...] if is_names else types[option])
    except (msgspec.ValidationError, TypeError, ValueError) as error:
        raise InputError(f"{where}: is {shown(value)}: {one_line(str(error))}") from None


def _numbers(option: str, value: Any) -> Any:
    if isinstance(value, dict) and option:
        return {str(joint): _numbers("", row) for joint, row in value.items()}
    if option == "position_clip" and isinstance(value, str):
        return value
    try:
        array = np.array(value)
        if array.dtype.kind in "iuf" and array.ndim <= 2 and not np.isnan(array).any():
            return array.astype(np.float64).reshape((-1, 2) if option == "position_clip" else array.shape)
    except ValueError:  # ragged
        pass
    raise ValueError("expected a number, one for each joint, or a mapping from names or patterns of joints")


# --- names ---


class _Names:
    """Names that the fields of all layers refer to: joints, and terms, which sources may call differently."""

    def __init__(self, layers: Sequence[Layer], where: str) -> None:
        names: dict[str, tuple[str, ...]] = {}
        self.kinds: dict[str, str] = {}
        for layer in layers:
            for name, value in layer.values.items():
                if name in ("joint_names", "observation", "command_names"):
                    names[name] = checked(name, value, f"{where}: {layer.source}: {name}")
                elif name.endswith(".kind"):
                    self.kinds[term_option(name)[0]] = str(value)
        self.joints, self.terms = names.get("joint_names", ()), names.get("observation", ())
        self.commands = names.get("command_names", ())

    def kind(self, name: str) -> str:
        return term_kind(self.kinds.get(name, name), self.commands).name

    def owners(self, key: str, found: Mapping[str, Statement]) -> tuple[str, ...]:
        """Return the joints, in order, for each of which a field has a value."""
        if key in ("action_scale", "action_offset", "position_clip") and "action_joint_names" in found:
            return found["action_joint_names"].value  # type: ignore[no-any-return]
        return self.joints

    def resolved(self, layer: Layer, found: Mapping[str, Statement], where: str) -> Iterator[tuple[str, Any]]:
        """Yield a layer's fields with names, places and patterns of joints resolved."""
        # Names of the driven joints come first: values for each of them may be given by name.
        for name in sorted(layer.values, key=lambda name: name != "action_joint_names"):
            place = f"{where}: {layer.source}: {name}"
            key, value = self._key(name, layer, place), checked(name, layer.values[name], place)
            if self.joints and value is not None and (name == "action_joint_names" or name.endswith(".joints")):
                value = _chosen(value, self.joints, place)
            elif self.joints and isinstance(value, dict):
                value = _by_name(value, self.owners(name, found), name, place)
            if key:
                yield key, value

    def _key(self, name: str, layer: Layer, place: str) -> str:
        """Return the field that a statement is of; empty for one of a term that the observation lacks."""
        term, option = term_option(name)
        if not name.startswith("observation.") or term in self.terms:
            return name
        same = [own for own in self.terms if self.kind(own) == self.kind(term)]
        if len(same) == 1:
            return f"observation.{same[0]}.{option}"
        if layer.is_decisive and self.terms and "observation" not in layer.values:
            raise InputError(f"{place}: {known_names('observation term', term, self.terms)}")
        return ""


def term_option(name: str) -> tuple[str, str]:
    """Return the term and the option of a field `observation.TERM.OPTION`; a term's name may have dots."""
    term, _, option = name.removeprefix("observation.").rpartition(".")
    return term, option


def matches(pattern: str, joint: str, where: str) -> bool:
    """Return True if a name or pattern is for a joint. Raises `InputError` if it is neither."""
    try:
        return pattern == joint or re.fullmatch(pattern, joint) is not None
    except re.error as error:
        raise InputError(f"{where}: {pattern!r} is not a pattern of names: {error}") from None


def _chosen(value: Any, joints: tuple[str, ...], where: str) -> tuple[str, ...]:
    """Return the joints that names, places or patterns of them choose; patterns in the order of the joints."""
    if isinstance(value, slice):
        return joints[value]
    if isinstance(value, list):
        if not all(0 <= place < len(joints) for place in value) or len(set(value)) < len(value):
            raise InputError(f"{where}: is {shown(value)}, expected places of {len(joints)} joints, none twice")
        return tuple(joints[place] for place in value)
    if all(item in joints for item in value):
        return tuple(value)
    for item in value:
        if not any(matches(item, joint, where) for joint in joints):
            raise InputError(f"{where}: {known_names('joint', item, joints)}")
    return tuple(joint for joint in joints if any(matches(item, joint, where) for item in value))


def _by_name(value: Mapping[str, Any], owners: tuple[str, ...], key: str, where: str) -> FloatArray:
    """Return values by name or pattern as an array; joints that are left out have no limit, or are refused."""
    usual = {"effort_limit": np.array(np.inf), "position_clip": np.array([-np.inf, np.inf])}.get(key)
    rows: dict[str, Any] = {} if usual is None else dict.fromkeys(owners, usual)
    for pattern, row in value.items():
        matching = [owner for owner in owners if matches(pattern, owner, where)]
        if not matching and pattern.isidentifier():  # a name; patterns may be for joints that this robot lacks
            raise InputError(f"{where}: {known_names('joint', pattern, owners)}")
        rows |= dict.fromkeys(matching, row)
    lacking = [owner for owner in owners if owner not in rows]
    if lacking:
        raise InputError(f"{where}: lacks {list_joints(lacking, len(owners))}, expected each joint")
    if len({np.shape(row) for row in rows.values()}) > 1:
        raise InputError(f"{where}: is {shown(dict(value))}, expected one number for each name, or one pair")
    return np.array([rows[owner] for owner in owners], dtype=np.float64)


# --- two values of one field ---


def _merged(key: str, old: Statement, new: Statement, names: _Names, owners: Sequence[str]) -> Statement | str:
    """Return what two statements agree in; or, in words, what they differ in."""
    a, b = old.value, new.value
    if isinstance(a, np.ndarray | float) and isinstance(b, np.ndarray | float):
        return _merged_numbers(key, old, new, owners)
    if key == "observation":
        kinds = [names.kind(name) for name in a], [names.kind(name) for name in b]
        # The later names count: options of terms stand under them.
        return new if kinds[0] == kinds[1] else _names_differ(key, old, new, *kinds)
    if key == "command_names" and ("motion" in a) == ("motion" in b):  # any other name is a velocity's
        return old
    if type(a) is type(b) and (isinstance(a, dict) or a == b):  # values by name cannot be compared without joints
        return old
    if isinstance(a, tuple) and isinstance(b, tuple) and key.endswith("names"):
        return _names_differ(key, old, new, a, b)
    return f"{key}: {shown(a)} in {old.source}, {shown(b)} in {new.source}"


def _names_differ(key: str, old: Statement, new: Statement, a: Sequence[str], b: Sequence[str]) -> str:
    """Return the names that only one of two lists has; where both have the same, the first place that differs."""
    parts = []
    for statement, mine, other in ((old, a, b), (new, b, a)):
        surplus = [name for name, kind in zip(statement.value, mine, strict=True) if kind not in other]
        parts += [f"{', '.join(surplus)} only in {statement.source}"] if surplus else []
    if not parts:
        place = int(np.argmax([x != y for x, y in zip(a, b, strict=False)]))
        there = (f"{statement.value[place]} in {statement.source}" for statement in (old, new))
        parts = [f"the order differs at place {place}: {', '.join(there)}"]
    return f"{key}: {'; '.join(parts)}"


def _merged_numbers(key: str, old: Statement, new: Statement, owners: Sequence[str]) -> Statement | str:
    """Return the exact one of two lists of numbers where the other is rounded, joints with both values otherwise."""
    a, b = np.asarray(old.value, dtype=np.float64), np.asarray(new.value, dtype=np.float64)
    if a.shape != b.shape and 1 not in (a.size, b.size):
        return f"{key}: {a.size} values in {old.source}, {b.size} in {new.source}"
    with np.errstate(invalid="ignore"):
        differs = ~((a == b) | (np.abs(a - b) <= 1e-9 * np.maximum(np.abs(a), np.abs(b)) + _unit(a) + _unit(b)))
    if not differs.any():
        if a.size != b.size:
            return old if a.size > b.size else new
        if _digits(a) == _digits(b):
            return new
        fine, coarse = (old, new) if _digits(a) > _digits(b) else (new, old)
        return Statement(fine.value, f"{fine.source} ({coarse.source} has it rounded)")
    if differs.ndim != 1 or len(owners) != len(differs):
        return f"{key}: {shown(old.value)} in {old.source}, {shown(new.value)} in {new.source}"
    a, b = np.broadcast_arrays(a, b)
    pairs: dict[tuple[float, float], list[str]] = {}
    for i in np.flatnonzero(differs).tolist():
        pairs.setdefault((a[i], b[i]), []).append(owners[i])
    parts = [f"{list_joints(joints, len(owners))} {x:g} against {y:g}" for (x, y), joints in pairs.items()]
    listed = "; ".join(parts[:4]) + (f"; and {len(parts) - 4} more" if len(parts) > 4 else "")
    return f"{key}: {old.source} and {new.source} differ: {listed}"


def _digits(values: FloatArray) -> tuple[int, int]:
    """Return the most significant digits, and decimals, with which any of these numbers is written."""
    texts = [np.format_float_positional(abs(x), trim="-") for x in values.ravel() if np.isfinite(x) and x]
    decimals = max((len(text.partition(".")[2]) for text in texts), default=0)
    significant = max((len(text.replace(".", "").strip("0")) for text in texts), default=0)
    return significant, decimals


def _unit(values: FloatArray) -> FloatArray:
    """Return half a unit in the last place, for each number of a list that an exporter may have rounded; else 0.

    Exporters write at most three decimals, or three significant digits. A list with a single digit is not a rounded
    one: 0.2 is not 0.25.
    """
    significant, decimals = _digits(values)
    half = np.full(values.shape, 0.5 * 10.0**-decimals if significant >= 2 and 1 <= decimals <= 3 else 0.0)
    if significant == 3:
        size = np.abs(values)
        places = np.floor(np.log10(size, out=np.full(size.shape, -np.inf), where=size > 0.0)) - 2.0
        half = np.maximum(half, 0.5 * 10.0**places)
    return half * (1.0 + 1e-6)


# --- the contract of joined fields ---


def _kinds(values: Mapping[str, Any]) -> list[TermKind]:
    names, commands = values.get("observation", ()), values.get("command_names", ())
    return [term_kind(values.get(f"observation.{name}.kind", name), commands) for name in names]


def _derive(found: dict[str, Statement]) -> None:
    """Add what no source has to state, because it follows from other fields."""
    if "joint_names" in found:
        found.setdefault("action_joint_names", Statement(found["joint_names"].value, "follows from joint_names"))
    if "observation" not in found:
        return
    kinds = _kinds({name: statement.value for name, statement in found.items()})
    tasks = [task for task in ("tracking", "piano") if any(kind.task == task for kind in kinds)]
    derived: dict[str, Any] = {"task_type": (*tasks, "locomotion")[0], "command_names": ()}
    if all(kind.requires != "body_names" for kind in kinds):
        derived["body_names"] = ()
    for name, value in derived.items():
        found.setdefault(name, Statement(value, "follows from observation"))
    assumed = found.get("reference_quaternion", Statement("", "")).source
    if found["task_type"].value != "tracking" and is_assumed(assumed):
        del found["reference_quaternion"]  # of no meaning without a motion


def _missing(values: Mapping[str, Any]) -> Iterator[str]:
    has_clock = values.get("phase", "") is not None and any(name.startswith("phase") for name in values)
    for name in dict.fromkeys([*REQUIRED, *(kind.requires for kind in _kinds(values) if kind.requires)]):
        if name == "phase" and has_clock:
            if "phase.period" not in values:
                yield "phase.period"
        elif name not in values or (name == "anchor_body" and not values[name]):
            yield name
    if "command" in values.get("observation", ()) and not values.get("command_names"):
        yield "command_names"


def build(values: Mapping[str, Any], source: Mapping[str, str]) -> PolicyContract:
    """Return the contract of joined fields. Raises `FieldError` if they do not fit each other."""
    plain: dict[str, Any] = {}
    parts: dict[str, dict[str, Any]] = {"phase": {}, "tensors": {}}
    options: dict[str, dict[str, Any]] = {name: {} for name in values["observation"]}
    for name, value in values.items():
        whole, _, part = name.partition(".")
        if whole == "observation" and part:
            term, option = term_option(name)
            options[term][option] = value
        elif part:
            parts[whole][part] = value
        elif name != "phase":
            plain[name] = value
    plain["observation"] = tuple(Term(**{**own, "name": name}) for name, own in options.items())
    if parts["phase"]:
        plain["phase"] = PhaseRule(**parts["phase"])
    return PolicyContract(**plain, tensors=TensorNames(**parts["tensors"]), source=source)
