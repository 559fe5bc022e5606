"""Contracts in layers: each source states some fields, and the later source wins.

Order: a dialect's assumptions, the model's metadata, the trainer's files beside it, `x.contract.yaml`. Where two of the
trainer's own sources differ by more than rounding both are named, and `x.contract.yaml` alone decides between them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_type_hints

import msgspec
import numpy as np

from humanoid_sim.controllers.contract import PhaseRule, PolicyContract, TensorNames, Term
from humanoid_sim.controllers.terms import TermKind, term_kind
from humanoid_sim.errors import FieldError, InputError, blaming, known_names
from humanoid_sim.mit import HEIGHT_SCAN, FloatArray
from humanoid_sim.names import list_joints
from humanoid_sim.policy.findings import is_assumed, shown

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

    path: Path  # of the checkpoint
    values: Mapping[str, Any]  # by field, as in `Layer.values`, in the order of the joints
    source: Mapping[str, str]
    replaced: Mapping[str, tuple[Statement, ...]]
    differences: Mapping[str, str]  # by field, between the trainer's own sources
    missing: tuple[str, ...]
    unused: tuple[str, ...]
    outline: PolicyContract | None
    """The contract, with something harmless in the place of what is missing; None without joints or terms."""

    @property
    def contract(self) -> PolicyContract | None:
        """None where something is missing."""
        return None if self.missing else self.outline

    @property
    def problems(self) -> dict[str, str]:
        """What keeps the contract from being used, by field."""
        hand = f"{self.path.stem}.contract.yaml"
        found = {field: f"{text} (the right value in {hand} decides)" for field, text in self.differences.items()}
        lacking = f"lacks {', '.join(self.missing)}: give what is missing in {hand}"
        if "joint_names" in self.missing and "env.yaml" in self.source.values():
            lacking += "; env.yaml has no order of the joints (Isaac Lab's is breadth first, mjlab's that of the MJCF)"
        return {"contract": lacking, **found} if self.missing else found

    def required_contract(self) -> PolicyContract:
        """Return the contract. Raises `InputError` with everything that keeps it from being one."""
        if self.problems or self.contract is None:
            lines = (text if field == "contract" else f"{field}: {text}" for field, text in self.problems.items())
            raise InputError(f"{self.path}: {'; '.join(lines)}")
        return self.contract


def join(layers: Sequence[Layer], path: Path) -> Reading:
    """Join what the sources of the checkpoint at `path` state. Raises `InputError` for a value that cannot be."""
    implied = [layer for layer in layers if is_assumed(layer.source)]
    # Of assumptions the first source's count: the model's own metadata knows its dialect best.
    ordered = [*reversed(implied), *(layer for layer in layers if layer not in implied)]
    places = [(layer, name, f"{path}: {layer.source}: {name}") for layer in ordered for name in layer.values]
    given = [(layer, name, checked(name, layer.values[name], place), place) for layer, name, place in places]
    names = _Names({name: (value, place) for _, name, value, place in given})
    found: dict[str, Statement] = {}
    replaced: dict[str, tuple[Statement, ...]] = {}
    differences: dict[str, str] = {}
    for layer, name, value, place in given:
        key = names.key(name)
        if not key:
            if layer.is_decisive:
                raise InputError(f"{place}: is of no observation term, expected one of {', '.join(names.terms)}")
            continue
        old, new = found.get(key), Statement(names.value(key, value, place, is_exact=layer.is_decisive), layer.source)
        if old is not None and not is_assumed(old.source):
            difference = names.difference(key, old, new)
            if difference:
                replaced[key], differences[key] = (*replaced.get(key, ()), old), difference
            elif key != "observation":  # options of terms stand under the later names
                new = _exact(old, new)
        if layer.is_decisive or key in _MAY_DIFFER:
            differences.pop(key, None)
        found[key] = new
    missing = names.complete(found)
    fields = {key: statement.value for key, statement in found.items()}
    source = {key: statement.source for key, statement in found.items()}
    outline = None
    if names.joints and names.terms:
        try:
            outline = build({**fields, **{name: _NEUTRAL[name] for name in missing if name in _NEUTRAL}}, source)
        except FieldError as error:
            field = str(error).partition(":")[0].removeprefix("PolicyContract.")
            raise InputError(f"{path}: {error} ({source.get(field, 'its sources together')})") from None
    unused = tuple(line for layer in ordered for line in layer.unused)
    return Reading(path, fields, source, replaced, differences, missing, unused, outline)


class _Names:
    """The joints and terms by which sources give values, as the last source names them, and what the terms mean."""

    def __init__(self, last: Mapping[str, tuple[Any, str]]) -> None:
        """`last`: each field's last value, and where it stands."""
        self._last = {name: value for name, (value, _) in last.items()}
        self.joints: tuple[str, ...] = self._last.get("joint_names", ())
        self.terms: tuple[str, ...] = self._last.get("observation", ())
        self._driven = self.joints
        if "action_joint_names" in last:
            self._driven = self.value("action_joint_names", *last["action_joint_names"])

    def kind(self, term: str) -> TermKind:
        """Return what a term means, whichever source calls it so."""
        return term_kind(self._last.get(f"observation.{term}.kind", term), self._last.get("command_names", ()))

    def key(self, name: str) -> str:
        """Return a field under the last source's name of its term; empty if that has no such term."""
        owner, _, option = name.rpartition(".")
        term = owner.removeprefix("observation.")
        if not owner.startswith("observation.") or term in self.terms or not self.terms:
            return name
        same = [own for own in self.terms if self.kind(own).name == self.kind(term).name]
        return f"observation.{same[0]}.{option}" if len(same) == 1 else ""

    def value(self, key: str, value: Any, where: str, *, is_exact: bool = False) -> Any:
        """Return names of joints, and values by their names, in the order of the joints, where these are known.

        `is_exact`: every pattern has to be of a joint; those of a trainer may be for joints that this robot lacks.
        """
        with blaming(f"{where}: {shown(value)} has no pattern of names", re.error):
            if self.joints and value is not None and (key == "action_joint_names" or key.endswith(".joints")):
                return _chosen(value, self.joints, where)
            if self.joints and isinstance(value, dict):
                return _by_name(value, self._owners(key), key, where, is_exact)
        return value

    def _owners(self, key: str) -> tuple[str, ...]:
        return self._driven if key in ("action_scale", "action_offset", "position_clip") else self.joints

    def difference(self, key: str, old: Statement, new: Statement) -> str:
        """Return how two sources differ by more than rounding; empty if they do not."""
        a, b = old.value, new.value
        both = f"{shown(a)} in {old.source}, {shown(b)} in {new.source}"
        if isinstance(a, tuple) and isinstance(b, tuple):
            ours, theirs = ([self.kind(x).name if key == "observation" else x for x in names] for names in (a, b))
            what = "the order differs" if sorted(ours) == sorted(theirs) else "differs"
            for i, (one, other) in enumerate(zip_longest(ours, theirs)):
                if one != other:
                    first, second = (names[i] if i < len(names) else "nothing" for names in (a, b))
                    return f"{what} at place {i}: {first} in {old.source}, {second} in {new.source}"
            return ""
        if not (isinstance(a, np.ndarray | float) and isinstance(b, np.ndarray | float)):
            # Values by name cannot be compared without joints.
            return "" if type(a) is type(b) and (isinstance(a, dict) or a == b) else both
        if np.shape(a) != np.shape(b) and 1 not in (np.size(a), np.size(b)):
            return f"{np.size(a)} values in {old.source}, {np.size(b)} in {new.source}"
        a, b = np.broadcast_arrays(a, b)
        with np.errstate(invalid="ignore"):  # infinity - infinity
            differs = ~((a == b) | (np.abs(a - b) <= rounding(old.value) + rounding(new.value)))
        if differs.shape != (len(self._owners(key)),):
            return both if differs.any() else ""
        rows = zip(self._owners(key), a, b, differs, strict=True)
        joints = {joint: f"{x:g} against {y:g}" for joint, x, y, is_far in rows if is_far}
        return f"{old.source} and {new.source} differ: {list_joints(joints)}" if joints else ""

    def complete(self, found: dict[str, Statement]) -> tuple[str, ...]:
        """Add the fields that follow from others, and return those that are missing."""
        kinds = [self.kind(name) for name in self.terms]
        if self.joints:
            found.setdefault("action_joint_names", Statement(self.joints, "follows from joint_names"))
        if self.terms:
            tasks = [task for task in ("tracking", "piano") if any(kind.task == task for kind in kinds)]
            derived: dict[str, Any] = {"task_type": (*tasks, "locomotion")[0], "command_names": ()}
            derived |= {"body_names": ()} if all(kind.requires != "body_names" for kind in kinds) else {}
            for name, value in derived.items():
                found.setdefault(name, Statement(value, "follows from observation"))
        needed = [*_REQUIRED, *(kind.requires.replace("phase", "phase.period") for kind in kinds if kind.requires)]
        needed += ["command_names"] if "command" in self.terms else []
        for name, kind in zip(self.terms, kinds, strict=True):
            if kind.name == HEIGHT_SCAN and f"observation.{name}.width" not in found:
                needed.append(f"observation.{name}.scan")  # its usual one is mjlab's alone
        needed += ["phase.period"] if any(name.startswith("phase.") for name in found) else []
        given = [name for name, (value, _) in found.items() if isinstance(value, np.ndarray) or value not in ("", ())]
        return tuple(dict.fromkeys(name for name in needed if name not in given))


def checked(name: str, value: Any, where: str) -> Any:
    """Return the value of a field, as `Layer.values` names it, of the right kind; else raise `InputError`."""
    owner, _, option = name.rpartition(".")
    types = get_type_hints(_OWNERS[owner.partition(".")[0]])
    if option not in types:
        raise InputError(f"{where}: {known_names('field', option, types)}")
    kinds = (types[option], *get_args(types[option]))
    if value is None and type(None) in kinds:
        return None
    is_places = isinstance(value, list) and len(value) > 0 and all(type(item) is int for item in value)
    if option in ("action_joint_names", "joints") and (is_places or isinstance(value, slice)):
        return value
    choices = [kind for kind in kinds if isinstance(kind, str)]
    if choices and value not in choices:
        raise InputError(f"{where}: is {shown(value)}, expected {' or '.join(choices)}")
    with blaming(f"{where}: is {shown(value)}", (msgspec.ValidationError, TypeError, ValueError)):
        if option == "position_clip" and isinstance(value, str):
            return value
        if FloatArray in kinds:
            return _numbers(option, value)
        if name == "observation" or tuple[str, ...] in kinds:
            return msgspec.convert([value] if isinstance(value, str) else value, tuple[str, ...])
        return msgspec.convert(value, types[option])


def _numbers(option: str, value: Any) -> Any:
    if isinstance(value, dict):
        return {str(joint): _numbers(option, row) for joint, row in value.items()}
    with suppress(ValueError):  # of rows that differ in length
        array = np.array(value)
        if array.dtype.kind in "iuf" and array.ndim <= 2:
            return array.astype(np.float64).reshape((-1, 2) if option == "position_clip" else array.shape)
    raise ValueError("expected a number (no text), one for each joint, or a mapping from names or patterns of joints")


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


def _by_name(value: Mapping[str, Any], owners: tuple[str, ...], key: str, where: str, is_exact: bool) -> FloatArray:
    """Return values by name or pattern as an array; joints that are left out have no limit, or are refused."""
    usual = {"effort_limit": np.inf, "position_clip": np.array([[-np.inf, np.inf]])}
    rows: dict[str, Any] = dict.fromkeys(owners, usual[key]) if key in usual else {}
    for pattern, row in value.items():
        matching = [owner for owner in owners if re.fullmatch(pattern, owner)]
        if not matching and (is_exact or pattern.isidentifier()):
            raise InputError(f"{where}: {known_names('joint', pattern, owners)}")
        rows |= dict.fromkeys(matching, row)
    lacking = [owner for owner in owners if owner not in rows]
    if lacking:
        raise InputError(f"{where}: lacks {list_joints(lacking, len(owners))}, expected each joint")
    with blaming(f"{where}: is {shown(dict(value))}", (TypeError, ValueError)):
        array = np.array([rows[owner] for owner in owners], dtype=np.float64)
    return array.reshape(-1, 2) if key == "position_clip" else array


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
    magnitude = 10.0 ** np.floor(np.log10(np.maximum(np.abs(values), 1e-9)))  # 0.01 of it is the third digit
    return np.maximum(last_decimal, 0.00501 * magnitude if significant == 3 else 0.0)


def build(values: Mapping[str, Any], source: Mapping[str, str]) -> PolicyContract:
    """Return the contract of joined fields. Raises `FieldError` if they do not fit each other."""
    terms = {f"observation.{name}": {"name": name} for name in values["observation"]}
    parts: dict[str, dict[str, Any]] = {"": {}, "phase": {}, "tensors": {}, **terms}
    for name, value in values.items():
        owner, _, part = name.rpartition(".")
        parts[owner][part] = value
    fields = {**parts[""], "observation": [Term(**parts[f"observation.{name}"]) for name in values["observation"]]}
    if parts["phase"]:
        fields["phase"] = PhaseRule(**parts["phase"])
    return PolicyContract(**fields, tensors=TensorNames(**parts["tensors"]), source=source)
