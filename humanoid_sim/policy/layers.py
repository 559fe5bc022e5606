"""Contracts in layers: each source states some fields, and the later source wins.

Order: a dialect's assumptions, the model's metadata, the trainer's files beside it, `x.contract.yaml`. Where two of the
trainer's own sources differ by more than rounding both are named, and `x.contract.yaml` alone decides between them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any, NamedTuple, get_args, get_type_hints

import msgspec
import numpy as np

from humanoid_sim.controllers.contract import PhaseRule, PolicyContract, TensorNames, Term
from humanoid_sim.controllers.terms import TermKind, term_kind
from humanoid_sim.errors import FieldError, InputError, blaming, known_names
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.findings import list_joints, shown

COMMAND_AXES = ("lin_vel_x", "lin_vel_y", "ang_vel_z")  # of a contract's `command_ranges`, in files
MALFORMED = (TypeError, ValueError, LookupError, AttributeError, ArithmeticError)
"""Errors of a reader that meets a document of another form."""
_REQUIRED = {
    **{"joint_names": None, "joint_stiffness": 1.0, "joint_damping": 1.0, "default_joint_pos": 0.0},
    **{"observation": None, "action_scale": 1.0, "policy_dt": 0.02},
}
_NEUTRAL: Mapping[str, Any] = {**_REQUIRED, "anchor_body": "?", "lookahead_steps": (1,), "phase.period": 1.0}
"""In the place of missing values: the observation's width is known all the same."""
_MAY_DIFFER = ("command_ranges", "command_names", "dataset_repo_id")  # between a trainer and its deployment
_NAMES = ("joint_names", "body_names", "command_names", "observation", "action_joint_names", "joints")
_NUMBERS = (
    *("joint_stiffness", "joint_damping", "default_joint_pos", "effort_limit", "action_scale", "action_offset"),
    *("position_clip", "command_ranges", "scale", "offsets"),
)
_OWNERS = {"": PolicyContract, "phase": PhaseRule, "tensors": TensorNames, "observation": Term}


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
    """All that the sources of a checkpoint state."""

    values: Mapping[str, Any]  # by field, as in `Layer.values`, in the order of the joints
    source: Mapping[str, str]
    replaced: Mapping[str, tuple[Statement, ...]]
    differences: tuple[str, ...]  # between the trainer's own sources, a line for each field
    missing: tuple[str, ...]
    unused: tuple[str, ...]
    outline: PolicyContract | None = None
    """The contract, with something harmless in the place of what is missing; None without joints or terms."""

    @property
    def contract(self) -> PolicyContract | None:
        """None where something is missing."""
        return None if self.missing else self.outline

    def refusal(self, hand: str) -> str:
        """Return all that keeps the contract from being used, as one line; `hand`: the contract.yaml that decides."""
        parts = [f"{line} (the right value in {hand} decides)" for line in self.differences]
        if self.missing:
            parts.append(f"lacks {', '.join(self.missing)}: give what is missing in {hand}")
        return "; ".join(parts)


def is_assumed(source: str) -> bool:
    """Return True if no source states a field, but a dialect implies it."""
    return source.startswith("assumed")


def join(layers: Sequence[Layer], where: str) -> Reading:
    """Join what several sources of the checkpoint `where` state. Raises `InputError` for a value that cannot be."""
    implied = [layer for layer in layers if is_assumed(layer.source)]
    # Of assumptions the first source's count: the model's own metadata knows its dialect best.
    ordered = [*reversed(implied), *(layer for layer in layers if layer not in implied)]
    joints: tuple[str, ...] = ()
    for layer in ordered:
        if "joint_names" in layer.values:
            joints = checked("joint_names", layer.values["joint_names"], f"{where}: {layer.source}: joint_names")
    joined = _Joined(joints)
    for layer in ordered:
        for name in sorted(layer.values, key=_order):
            joined.add(name, layer, f"{where}: {layer.source}: {name}")
    values, source, missing = joined.finish()
    unused = tuple(line for layer in ordered for line in layer.unused)
    outline = None
    if values.keys() >= {"joint_names", "observation"}:
        try:
            outline = build({**values, **{name: _NEUTRAL[name] for name in missing if name in _NEUTRAL}}, source)
        except FieldError as error:
            field = str(error).partition(":")[0].removeprefix("PolicyContract.")
            raise InputError(f"{where}: {error} ({source.get(field, 'its sources together')})") from None
    return Reading(values, source, joined.replaced, tuple(joined.differences.values()), missing, unused, outline)


def _order(name: str) -> int:
    """Names come first, as other values may be given by them, and kinds of terms before the terms."""
    if name in ("action_joint_names", "command_names") or name.endswith(".kind"):
        return 0
    return 1 if name == "observation" else 2


class _Joined:
    """What the sources so far state together."""

    def __init__(self, joints: tuple[str, ...]) -> None:
        self.joints = joints  # as the last source names them
        self.found: dict[str, Statement] = {}
        self.replaced: dict[str, tuple[Statement, ...]] = {}
        self.differences: dict[str, str] = {}

    def add(self, name: str, layer: Layer, where: str) -> None:
        """Take a field of the next source."""
        key, value = self._resolved(name, layer, where)
        new, old = Statement(value, layer.source), self.found.get(key)
        if old is not None and not is_assumed(old.source):
            difference = self._difference(key, old, new)
            if difference:
                self.replaced[key] = (*self.replaced.get(key, ()), old)
                self.differences[key] = difference
            elif key != "observation":  # options of terms stand under the later names
                new = _exact(old, new)
        if layer.is_decisive or key in _MAY_DIFFER:
            self.differences.pop(key, None)
        if key == "observation":
            self.found = {self._renamed(one, value): statement for one, statement in self.found.items()}
            self.found.pop("", None)
        self.found[key] = new

    def finish(self) -> tuple[dict[str, Any], dict[str, str], tuple[str, ...]]:
        """Return values and sources by field, with what follows from others, and the fields that are missing."""
        terms = self._value("observation", ())
        kinds = [self._kind(name) for name in terms]
        if "joint_names" in self.found:
            self._follow("action_joint_names", self.joints, "joint_names")
        if "observation" in self.found:
            tasks = [task for task in ("tracking", "piano") if any(kind.task == task for kind in kinds)]
            self._follow("task_type", (*tasks, "locomotion")[0], "observation")
            self._follow("command_names", (), "observation")
            if all(kind.requires != "body_names" for kind in kinds):
                self._follow("body_names", (), "observation")
        needed = [*_REQUIRED, *(kind.requires.replace("phase", "phase.period") for kind in kinds if kind.requires)]
        if "command" in terms:
            needed.append("command_names")
        values = {name: statement.value for name, statement in self.found.items()}
        given = [name for name, value in values.items() if isinstance(value, np.ndarray) or value]
        missing = tuple(dict.fromkeys(name for name in needed if name not in given))
        return values, {name: statement.source for name, statement in self.found.items()}, missing

    def _follow(self, name: str, value: Any, other: str) -> None:
        self.found.setdefault(name, Statement(value, f"follows from {other}"))

    def _value(self, name: str, usual: Any) -> Any:
        return self.found[name].value if name in self.found else usual

    def _kind(self, term: str) -> TermKind:
        return term_kind(self._value(f"observation.{term}.kind", term), self._value("command_names", ()))

    def _owners(self, key: str) -> tuple[str, ...]:
        of_action = key in ("action_scale", "action_offset", "position_clip")
        return self._value("action_joint_names", self.joints) if of_action else self.joints  # type: ignore[no-any-return]

    def _resolved(self, name: str, layer: Layer, where: str) -> tuple[str, Any]:
        """Return field and value with joints and terms as the other sources have them."""
        value = checked(name, layer.values[name], where)
        if name.startswith("observation.") and layer.is_decisive and "observation" in self.found:
            terms = self.found["observation"].value
            name = self._renamed(name, terms)
            if not name:
                raise InputError(f"{where}: is of no observation term, expected one of {', '.join(terms)}")
        with blaming(f"{where}: is no pattern of names", re.error):
            if self.joints and value is not None and (name == "action_joint_names" or name.endswith(".joints")):
                return name, _chosen(value, self.joints, where)
            if self.joints and isinstance(value, dict):
                return name, _by_name(value, self._owners(name), name, where)
        return name, value

    def _renamed(self, key: str, names: Sequence[str]) -> str:
        """Return a field with the name that another source gives its term; empty if that has no such term."""
        term, option = term_option(key)
        if not key.startswith("observation.") or term in names:
            return key
        same = [name for name in names if self._kind(name).name == self._kind(term).name]
        return f"observation.{same[0]}.{option}" if len(same) == 1 else ""

    def _difference(self, key: str, old: Statement, new: Statement) -> str:
        """Return how two sources differ by more than rounding; empty if they do not."""
        a, b = old.value, new.value
        both = f"{key}: {shown(a)} in {old.source}, {shown(b)} in {new.source}"
        if isinstance(a, tuple) and isinstance(b, tuple):
            ours, theirs = ([self._kind(name).name if key == "observation" else name for name in x] for x in (a, b))
            what = "the order differs" if sorted(ours) == sorted(theirs) else "differs"
            for i, (one, other) in enumerate(zip_longest(ours, theirs)):
                if one != other:
                    first, second = (names[i] if i < len(names) else "nothing" for names in (a, b))
                    return f"{key}: {what} at place {i}: {first} in {old.source}, {second} in {new.source}"
            return ""
        if not (isinstance(a, np.ndarray | float) and isinstance(b, np.ndarray | float)):
            # Values by name cannot be compared without joints.
            return "" if type(a) is type(b) and (isinstance(a, dict) or a == b) else both
        a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
        if a.shape != b.shape and 1 not in (a.size, b.size):
            return f"{key}: {a.size} values in {old.source}, {b.size} in {new.source}"
        with np.errstate(invalid="ignore"):  # infinity - infinity
            differs = ~((a == b) | (np.abs(a - b) <= rounding(a) + rounding(b)))
        if differs.shape != (len(self._owners(key)),):
            return both if differs.any() else ""
        rows = zip(self._owners(key), *np.broadcast_arrays(a, b, differs), strict=True)
        joints = {joint: f"{x:g} against {y:g}" for joint, x, y, is_far in rows if is_far}
        return f"{key}: {old.source} and {new.source} differ: {list_joints(joints)}" if joints else ""


# --- values as sources write them ---


def checked(name: str, value: Any, where: str) -> Any:
    """Return the value of a field, as `Layer.values` names it, of the right kind; else raise `InputError`."""
    whole, _, part = name.partition(".")
    option = part.rpartition(".")[2] or whole
    types = get_type_hints(_OWNERS[whole if part else ""])
    if option not in types:
        raise InputError(f"{where}: {known_names('field', option, types)}")
    if value is None and type(None) in get_args(types[option]):
        return None
    is_places = isinstance(value, list) and len(value) > 0 and all(type(item) is int for item in value)
    if option in ("action_joint_names", "joints") and (is_places or isinstance(value, slice)):
        return value
    with blaming(f"{where}: is {shown(value)}", (msgspec.ValidationError, TypeError, ValueError)):
        if option == "position_clip" and isinstance(value, str):
            return value
        if option in _NUMBERS:
            return _numbers(option, value)
        if option in _NAMES and whole != "tensors":
            return msgspec.convert([value] if isinstance(value, str) else value, tuple[str, ...])
        return msgspec.convert(value, types[option])


def _numbers(option: str, value: Any) -> Any:
    if isinstance(value, dict):
        return {str(joint): _numbers(option, row) for joint, row in value.items()}
    array = np.array(value)
    if array.dtype.kind not in "iuf" or array.ndim > 2:
        raise ValueError("expected a number, one for each joint, or a mapping from names or patterns of joints")
    return array.astype(np.float64).reshape((-1, 2) if option == "position_clip" else array.shape)


def _chosen(value: Any, joints: tuple[str, ...], where: str) -> tuple[str, ...]:
    """Return the joints that names, places or patterns of them choose; patterns in the order of the joints."""
    if isinstance(value, slice):
        return joints[value]
    if isinstance(value, list):
        if not all(0 <= place < len(joints) for place in value):
            raise InputError(f"{where}: is {shown(value)}, expected places of {len(joints)} joints")
        return tuple(joints[place] for place in value)
    if all(item in joints for item in value):
        return tuple(value)
    for item in value:
        if not any(re.fullmatch(item, joint) for joint in joints):
            raise InputError(f"{where}: {known_names('joint', item, joints)}")
    return tuple(joint for joint in joints if any(re.fullmatch(item, joint) for item in value))


def _by_name(value: Mapping[str, Any], owners: tuple[str, ...], key: str, where: str) -> FloatArray:
    """Return values by name or pattern as an array; joints that are left out have no limit, or are refused."""
    usual = {"effort_limit": np.inf, "position_clip": np.array([[-np.inf, np.inf]])}
    rows: dict[str, Any] = dict.fromkeys(owners, usual[key]) if key in usual else {}
    for pattern, row in value.items():
        matching = [owner for owner in owners if re.fullmatch(pattern, owner)]
        if not matching and pattern.isidentifier():  # a name; patterns may be for joints that this robot lacks
            raise InputError(f"{where}: {known_names('joint', pattern, owners)}")
        rows |= dict.fromkeys(matching, row)
    lacking = [owner for owner in owners if owner not in rows]
    if lacking:
        raise InputError(f"{where}: lacks {list_joints(lacking, len(owners))}, expected each joint")
    with blaming(f"{where}: is {shown(dict(value))}", (TypeError, ValueError)):
        array = np.array([rows[owner] for owner in owners], dtype=np.float64)
    return array.reshape(-1, 2) if key == "position_clip" else array


def term_option(name: str) -> tuple[str, str]:
    """Return the term and the option of a field `observation.TERM.OPTION`; a term's name may have dots."""
    term, _, option = name.removeprefix("observation.").rpartition(".")
    return term, option


# --- two values of one field ---


def _exact(old: Statement, new: Statement) -> Statement:
    """Return the more exact one of two equal statements: exporters write rounded numbers, or one for all joints."""
    if not isinstance(new.value, np.ndarray | float):
        return old
    if _digits(old.value) == _digits(new.value):
        return old if np.size(old.value) > np.size(new.value) else new
    fine, coarse = (old, new) if _digits(old.value) > _digits(new.value) else (new, old)
    return Statement(fine.value, f"{fine.source} ({coarse.source} has it rounded)")


def _digits(values: FloatArray | float) -> tuple[int, int]:
    """Return the most significant digits, and decimals, with which any of these numbers is written."""
    texts = [np.format_float_positional(abs(x), trim="-") for x in np.ravel(values) if np.isfinite(x) and x]
    decimals = max((len(text.partition(".")[2]) for text in texts), default=0)
    significant = max((len(text.replace(".", "").strip("0")) for text in texts), default=0)
    return significant, decimals


def rounding(values: FloatArray) -> FloatArray:
    """Return by how much an exporter may have rounded each number of a list.

    Exporters write at most three decimals, or three significant digits. A list with a single digit is not a rounded
    one: 0.2 is not 0.25.
    """
    significant, decimals = _digits(values)
    last_decimal = 0.501 * 10.0**-decimals if significant >= 2 and 1 <= decimals <= 3 else 1e-9
    return np.maximum(last_decimal, 0.005 * np.abs(values) if significant == 3 else 0.0)


# --- the contract of joined fields ---


def build(values: Mapping[str, Any], source: Mapping[str, str]) -> PolicyContract:
    """Return the contract of joined fields. Raises `FieldError` if they do not fit each other."""
    plain: dict[str, Any] = {}
    parts: dict[str, dict[str, Any]] = {"phase": {}, "tensors": {}}
    options: dict[str, dict[str, Any]] = {name: {"name": name} for name in values["observation"]}
    for name, value in values.items():
        whole, _, part = name.partition(".")
        if whole == "observation" and part:
            term, option = term_option(name)
            options[term][option] = value
        elif part:
            parts[whole][part] = value
        else:
            plain[name] = value
    plain["observation"] = tuple(Term(**own) for own in options.values())
    if parts["phase"]:
        plain["phase"] = PhaseRule(**parts["phase"])
    return PolicyContract(**plain, tensors=TensorNames(**parts["tensors"]), source=source)
