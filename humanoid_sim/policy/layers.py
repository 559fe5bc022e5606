"""Contracts in layers: what each source says of each field, joined so that the later one wins.

Order: a dialect's own assumptions, the model's metadata, the trainer's files beside it, `x.contract.yaml`. Two sources
of a trainer's that differ by more than rounding are both named: only `x.contract.yaml` decides between them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, get_type_hints

import msgspec
import numpy as np

from humanoid_sim.controllers.contract import JOINT_LIMITS, HeightScan, PhaseRule, PolicyContract, TensorNames, Term
from humanoid_sim.controllers.terms import TermKind, term_kind
from humanoid_sim.errors import FieldError, InputError, known_names, one_line
from humanoid_sim.policy.words import name_joints, shown

DEFAULT = "default"
"""Source of a field that no layer gives: the usual meaning stands."""
ROBOTS_ORDER = "robot's own order"
COMMAND_AXES = ("lin_vel_x", "lin_vel_y", "ang_vel_z")
"""Axes of the velocity command in files, in the order of a contract's `command_ranges`."""

_PER_JOINT = ("joint_stiffness", "joint_damping", "default_joint_pos", "effort_limit")
_PER_ACTION = ("action_scale", "action_offset", "position_clip")
_FREE = ("command_ranges", "dataset_repo_id")
"""Fields that a trainer and its deployment may well give differently: the later one is taken without a word."""
_REQUIRED = (
    *("joint_names", "joint_stiffness", "joint_damping", "default_joint_pos"),
    *("observation", "action_scale", "policy_dt"),
)


@dataclass(frozen=True, slots=True)
class Layer:
    """Statements of one source."""

    source: str
    """For people: `mjlab metadata`, `deploy.yaml`."""
    values: Mapping[str, Any]
    """By the contract's field, `phase.PART`, `tensors.PART` or `observation.TERM.OPTION`, as the source writes it.
    `observation` holds names alone. Values for each joint may be a mapping from names or patterns of them; names of
    joints may be places in `joint_names`, a slice of it, or patterns."""
    is_assumed: bool = False
    """The dialect implies it: everything that is stated comes before."""
    is_decisive: bool = False
    """A person wrote it, to decide between the others."""
    unused: tuple[str, ...] = ()
    """What it has that is not read, a line each."""


class Replaced(NamedTuple):
    """A value that a later layer replaced."""

    value: Any
    source: str


@dataclass(frozen=True, slots=True)
class Reading:
    """All that the sources of a checkpoint say, and what is wrong with it."""

    where: str
    values: Mapping[str, Any]
    """By field, as in `Layer.values`, checked and in the order of the joints."""
    source: Mapping[str, str]
    replaced: Mapping[str, tuple[Replaced, ...]]
    differences: tuple[str, ...]
    """Contradictions between the trainer's own sources, a line for each field."""
    missing: tuple[str, ...]
    problem: str
    """Why the fields do not make a contract; empty if they do, or some are missing."""
    unused: tuple[str, ...]
    """What was found and not read, a line each."""
    contract: PolicyContract | None
    """None where something is missing, or does not fit."""

    def refusal(self, hand: str) -> str:
        """Return everything that keeps the contract from being used, as one line; empty if nothing does.

        Args:
            hand: name of the contract.yaml that decides.
        """
        parts = [*self.differences]
        if parts:
            parts[-1] += f" (the right value in {hand} decides)"
        if self.missing:
            parts.append(f"lacks {', '.join(self.missing)}: give what is missing in {hand}")
        parts += [self.problem] if self.problem else []
        return "; ".join(parts)


def is_assumed(source: str) -> bool:
    """Return whether no source states a field, but a dialect implies it."""
    return source.startswith("assumed")


def is_from_robot(source: str) -> bool:
    """Return whether the robot gives the field, so that any robot with as many joints would fit."""
    return source.startswith(ROBOTS_ORDER) or source.endswith("and the robot")


# --- values as sources write them, checked ---


def _numbers(value: Any) -> Any:
    """Return a number, or an array of at most two dimensions."""
    flat = value if isinstance(value, list | tuple) else [value]
    array = np.array(value, dtype=np.float64)
    if any(isinstance(item, str | bool) for item in flat) or value is None or np.isnan(array).any() or array.ndim > 2:
        raise ValueError
    return array


def _for_each(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(name): _numbers(item) for name, item in value.items()}
    return _numbers(value)


def _pairs(value: Any) -> Any:
    if isinstance(value, dict):
        return _for_each(value)
    return value if isinstance(value, str) and value == JOINT_LIMITS else _numbers(value).reshape(-1, 2)


def _ranges(value: Any) -> Any:
    return _numbers([value.get(axis) for axis in COMMAND_AXES] if isinstance(value, dict) else value).reshape(3, 2)


def _names(value: Any) -> Any:
    items = [value] if isinstance(value, str) else value
    if not all(isinstance(item, str) for item in items):
        raise ValueError
    return tuple(items)


def _joints(value: Any) -> Any:
    """Return names or patterns, places or a slice."""
    if isinstance(value, slice):
        return value
    return tuple(value) if value and all(type(item) is int for item in value) else _names(value)


_EACH = "a number, one for each joint, or a mapping from names or patterns of joints"
_FORMS: Mapping[str, tuple[Callable[[Any], Any], str]] = {
    **dict.fromkeys((*_PER_JOINT, "action_scale", "action_offset"), (_for_each, _EACH)),
    **dict.fromkeys(("scale", "offsets", "frequency"), (_numbers, "a number, or a list of numbers")),
    "position_clip": (_pairs, f"[least, greatest] for each joint, or {JOINT_LIMITS}"),
    "command_ranges": (_ranges, f"[least, greatest] for {', '.join(COMMAND_AXES)}"),
    **dict.fromkeys(("joint_names", "body_names", "command_names", "observation"), (_names, "a list of names")),
    **dict.fromkeys(("action_joint_names", "joints"), (_joints, "a list of names, patterns or places")),
    "scan": (lambda value: msgspec.convert(value, HeightScan), "options of a height scan"),
}
"""By a field, or an option of a term: what makes its value of a source's, and what is accepted. Others go by type."""
_OPTIONAL = ("action_offset", "position_clip", "effort_limit", "command_ranges", "joints", "frequency")
_TYPES = {
    "": get_type_hints(PolicyContract),
    "phase": get_type_hints(PhaseRule),
    "tensors": get_type_hints(TensorNames),
    "observation": get_type_hints(Term),
}


def checked(name: str, value: Any, where: str) -> Any:
    """Return a field's value as the layers hold it. Raises `InputError` if it is of another kind.

    Args:
        name: as in `Layer.values`.
        where: the file and its field, for messages.
    """
    whole, _, part = name.partition(".")
    option = part.rpartition(".")[2] or whole
    types = _TYPES[whole if part else ""]
    if option not in types:
        owner = {"phase": "phase", "observation": "a term"}.get(whole if part else "", "a contract")
        raise InputError(f"{where}: {known_names(f'field of {owner}', option, types)}")
    if value is None and option in _OPTIONAL:
        return None
    convert, accepted = _FORMS.get(
        "" if whole == "tensors" else option, (lambda item: msgspec.convert(item, types[option]), "")
    )
    try:
        return convert(value)
    except (msgspec.ValidationError, FieldError) as error:
        raise InputError(f"{where}: is {shown(value)}: {one_line(str(error))}") from None
    except (TypeError, ValueError):
        raise InputError(f"{where}: is {shown(value)}, expected {accepted}") from None


# --- joining ---


def join(layers: Iterable[Layer], where: str, robot_joints: tuple[str, ...] | None = None) -> Reading:
    """Join what several sources say. Raises `InputError` for a value that no contract can have.

    Args:
        layers: in their order, the later one wins; assumptions come first, wherever they stand.
        where: the checkpoint.
        robot_joints: the robot's joints, where no source names the policy's.
    """
    given = list(layers)
    # Of assumptions the first source's count: the model's own metadata knows its dialect best.
    ordered = [*reversed([layer for layer in given if layer.is_assumed]), *(x for x in given if not x.is_assumed)]
    joined = _Joined(_Terms.of(ordered), _last(ordered, "joint_names") or ())
    if not joined.joints and robot_joints is None:
        joined.name_by_place(ordered)
    for layer in ordered:
        # Names of the driven joints come first: values for each of them may be given by name.
        for name in sorted(layer.values, key=lambda name: name != "action_joint_names"):
            key = joined.terms.key(name, layer, where)
            if key is not None:
                place = f"{where}: {layer.source}: {name}"
                joined.add(key, joined.in_order(key, checked(name, layer.values[name], place), place), layer)
    values, source = joined.values, joined.source
    _derive(values, source)
    missing = tuple(_missing(values, joined.terms.kinds(values.get("observation", ()))))
    reading = Reading(
        where,
        values,
        source,
        {key: tuple(items) for key, items in joined.replaced.items() if key in values},
        tuple(joined.differences.values()),
        missing,
        "",
        tuple(line for layer in ordered for line in layer.unused),
        None,
    )
    if missing:
        return reading
    try:
        return replace(reading, contract=build(values, source))
    except FieldError as error:
        return replace(reading, problem=_blamed(str(error), source))


@dataclass(slots=True)
class _Joined:
    """Fields of the layers so far."""

    terms: _Terms
    joints: tuple[str, ...]
    """The policy's; empty where no layer names them."""
    values: dict[str, Any] = field(default_factory=dict)
    source: dict[str, str] = field(default_factory=dict)
    replaced: dict[str, list[Replaced]] = field(default_factory=dict)
    differences: dict[str, str] = field(default_factory=dict)
    """By field, contradictions that nothing has decided."""
    assumed: set[str] = field(default_factory=set)

    def name_by_place(self, layers: Iterable[Layer]) -> None:
        """Call the joints by their places on a robot that nobody has named, where some source has a gain for each."""
        sizes = [np.size(layer.values["joint_stiffness"]) for layer in layers if "joint_stiffness" in layer.values]
        if max(sizes, default=1) > 1:
            self.joints = tuple(f"joint {i} of the robot" for i in range(max(sizes)))
            self.values["joint_names"], self.source["joint_names"] = self.joints, ROBOTS_ORDER

    def add(self, key: str, value: Any, layer: Layer) -> None:
        """Put a layer's value over what is there."""
        source = layer.source
        if key in self.values and key not in self.assumed:
            before = Replaced(self.values[key], self.source[key])
            both = _merge(key, before, Replaced(value, source), self.terms, self.owners(key))
            if isinstance(both, tuple):
                value, source = both
            else:
                self.replaced.setdefault(key, []).append(before)
                if not layer.is_decisive and key not in _FREE:
                    self.differences[key] = both
        if layer.is_decisive:
            self.differences.pop(key, None)
        (self.assumed.add if layer.is_assumed else self.assumed.discard)(key)
        if key == "phase" and value is None:  # takes the clock away that another source gives part by part
            for part in [name for name in self.values if name.startswith("phase.")]:
                del self.values[part], self.source[part]
        self.values[key], self.source[key] = value, source

    def owners(self, key: str) -> tuple[str, ...]:
        """Return the joints whose values a field holds, in their order."""
        driven = self.values.get("action_joint_names", self.joints)
        return tuple(driven) if key in _PER_ACTION else self.joints

    def in_order(self, key: str, value: Any, where: str) -> Any:
        """Return a value with names, places and patterns of joints resolved; arrays stay as they are."""
        if not self.joints or value is None:
            return value
        if key == "action_joint_names" or key.endswith(".joints"):
            is_pattern = not isinstance(value, slice) and all(isinstance(item, str) for item in value)
            if is_pattern and self.source.get("joint_names") == ROBOTS_ORDER and self.joints[0] not in value:
                return self.joints  # by place: no pattern of names fits them
            return _chosen(value, self.joints, where)
        return _by_name(value, self.owners(key), key, where) if isinstance(value, dict) else value


def _term_option(name: str) -> tuple[str, str]:
    """Return the term and the option of a field `observation.TERM.OPTION`; a term's name may have dots."""
    term, _, option = name.removeprefix("observation.").rpartition(".")
    return term, option


def _last(layers: Sequence[Layer], name: str) -> Any:
    found = [layer.values[name] for layer in layers if name in layer.values]
    is_list = bool(found) and isinstance(found[-1], list | tuple) and all(isinstance(item, str) for item in found[-1])
    return tuple(found[-1]) if is_list else None  # anything else is refused where it is added


@dataclass(frozen=True, slots=True)
class _Terms:
    """Names of the observation's terms, which sources may call differently, and their meaning."""

    names: tuple[str, ...]
    commands: tuple[str, ...]
    stated: Mapping[str, str] = field(default_factory=dict)
    """By the name of a term, its option `kind`."""

    @classmethod
    def of(cls, layers: Sequence[Layer]) -> _Terms:
        stated = {}
        for layer in layers:
            for name, value in layer.values.items():
                if name.startswith("observation.") and name.endswith(".kind"):
                    stated[_term_option(name)[0]] = str(value)
        names, commands = _last(layers, "observation") or (), _last(layers, "command_names") or ()
        return cls(tuple(map(str, names)), tuple(map(str, commands)), stated)

    def kind(self, name: str) -> TermKind:
        return term_kind(self.stated.get(name, name), self.commands)

    def kinds(self, names: Iterable[str]) -> list[TermKind]:
        return [self.kind(name) for name in names]

    def key(self, name: str, layer: Layer, where: str) -> str | None:
        """Return the field that a layer's statement is of; None for one of a term that the observation lacks."""
        if not name.startswith("observation."):
            return name
        term, option = _term_option(name)
        if term in self.names:
            return name
        same = [own for own in self.names if self.kind(own).name == self.kind(term).name]
        if len(same) == 1:
            return f"observation.{same[0]}.{option}"
        if layer.is_decisive and self.names and "observation" not in layer.values:
            raise InputError(f"{where}: {layer.source}: {known_names('observation term', term, self.names)}")
        return None


def _chosen(value: Any, joints: tuple[str, ...], where: str) -> tuple[str, ...]:
    """Return the joints that names, places or patterns of them choose; patterns in the order of the joints."""
    if isinstance(value, slice):
        return joints[value]
    if all(isinstance(item, str) for item in value):
        if all(item in joints for item in value):
            return tuple(value)
        found = tuple(joint for joint in joints if any(matches(item, joint, where) for item in value))
        alone = [item for item in value if not any(matches(item, joint, where) for joint in joints)]
        if alone:
            raise InputError(f"{where}: {known_names('joint', alone[0], joints)}")
        return found
    if not all(0 <= int(item) < len(joints) for item in value) or len(set(value)) < len(value):
        raise InputError(f"{where}: is {shown(list(value))}, expected places of {len(joints)} joints, none twice")
    return tuple(joints[int(item)] for item in value)


def _by_name(value: Mapping[str, Any], owners: tuple[str, ...], key: str, where: str) -> Any:
    """Return values by name or pattern as an array; joints that are left out have no limit, or make it absent."""
    rows: dict[str, Any] = {}
    for pattern, row in value.items():
        matching = [owner for owner in owners if owner == pattern or matches(pattern, owner, where)]
        if not matching and pattern.isidentifier():  # a name; patterns may be for joints that this robot lacks
            raise InputError(f"{where}: {known_names('joint', pattern, owners)}")
        rows |= dict.fromkeys(matching, row)
    usual = {"effort_limit": np.array(np.inf), "position_clip": np.array([-np.inf, np.inf])}.get(key)
    lacking = [owner for owner in owners if owner not in rows]
    if lacking and usual is None:
        raise InputError(f"{where}: lacks {name_joints(lacking, owners)}, expected each joint")
    if len({np.shape(row) for row in rows.values()}) > 1 or any(np.ndim(row) > 1 for row in rows.values()):
        raise InputError(f"{where}: is {shown(dict(value))}, expected one number for each name, or one pair")
    return np.array([rows.get(owner, usual) for owner in owners], dtype=np.float64)


def matches(pattern: str, joint: str, where: str) -> bool:
    """Return whether a pattern of a file's is for a joint. Raises `InputError` if it is none."""
    try:
        return re.fullmatch(pattern, joint) is not None
    except re.error as error:
        raise InputError(f"{where}: {pattern!r} is not a pattern of names: {error}") from None


# --- two values of one field ---


def _merge(key: str, first: Replaced, second: Replaced, terms: _Terms, owners: Sequence[str]) -> tuple[Any, str] | str:
    """Return the value that both stand for, and its source; or, in words, what they differ in."""
    a, b = first.value, second.value
    if key == "observation":
        same = [kind.name for kind in terms.kinds(a)] == [kind.name for kind in terms.kinds(b)]
        # The later names count: options of terms stand under them.
        return (b, second.source) if same else _different_names(key, first, second, terms)
    if key == "command_names":
        same = [name == "motion" for name in sorted(a)] == [name == "motion" for name in sorted(b)]
        return (a, first.source) if same else f"{key}: {_both(first, second)}"
    if isinstance(a, np.ndarray | float) and isinstance(b, np.ndarray | float):
        return _merge_numbers(key, first, second, owners)
    if isinstance(a, tuple) and isinstance(b, tuple) and key.endswith("names"):
        return (a, first.source) if a == b else _different_names(key, first, second, None)
    return (a, first.source) if type(a) is type(b) and bool(a == b) else f"{key}: {_both(first, second)}"


def _both(first: Replaced, second: Replaced) -> str:
    return f"{shown(first.value)} in {first.source}, {shown(second.value)} in {second.source}"


def _merge_numbers(key: str, first: Replaced, second: Replaced, owners: Sequence[str]) -> tuple[Any, str] | str:
    a, b = np.asarray(first.value, dtype=np.float64), np.asarray(second.value, dtype=np.float64)
    if a.shape != b.shape and 1 not in (a.size, b.size):
        return f"{key}: {a.size} values in {first.source}, {b.size} in {second.source}"
    longer = first if a.size > b.size else second
    with np.errstate(invalid="ignore"):
        differs = ~((a == b) | (np.abs(a - b) <= 1e-9 * np.maximum(np.abs(a), np.abs(b)) + _unit(a) + _unit(b)))
    if not differs.any():
        if _digits(a) == _digits(b) or a.size != b.size:
            return longer.value, longer.source
        fine, coarse = (first, second) if _digits(a) > _digits(b) else (second, first)
        return fine.value, f"{fine.source} ({coarse.source} has it rounded)"
    if differs.ndim == 1 and len(owners) == len(differs):
        wide = np.broadcast_arrays(a, b)
        pairs: dict[tuple[float, float], list[str]] = {}
        for i in map(int, np.nonzero(differs)[0]):
            pairs.setdefault((float(wide[0][i]), float(wide[1][i])), []).append(owners[i])
        parts = [f"{name_joints(names, owners)} {x:g} against {y:g}" for (x, y), names in pairs.items()]
        listed = "; ".join(parts[:4]) + (f"; and {len(parts) - 4} more" if len(parts) > 4 else "")
        return f"{key}: {first.source} and {second.source} differ: {listed}"
    return f"{key}: {_both(first, second)}"


def _digits(values: Any) -> tuple[int, int]:
    """Return the most significant digits, and decimals, with which any of these numbers is written."""
    texts = [np.format_float_positional(abs(x), trim="-") for x in np.ravel(values) if np.isfinite(x) and x]
    decimals = max((len(text.partition(".")[2]) for text in texts), default=0)
    significant = max((len(text.replace(".", "").strip("0")) for text in texts), default=0)
    return significant, decimals


def _unit(values: Any) -> Any:
    """Return half a unit in the last place, for each number of a list that an exporter may have rounded; else 0.

    Exporters write at most three decimals, or three significant digits. A list with a single digit is not a rounded
    one: 0.2 is not 0.25.
    """
    significant, decimals = _digits(values)
    unit = np.zeros(np.shape(values))
    if significant >= 2 and 1 <= decimals <= 3:
        unit = unit + 0.5 * 10.0**-decimals * (1.0 + 1e-6)
    if significant == 3:
        with np.errstate(divide="ignore"):
            places = np.floor(np.log10(np.abs(values))) - 2.0
        unit = np.maximum(unit, np.where(np.isfinite(places), 0.5 * 10.0**places * (1.0 + 1e-6), 0.0))
    return unit


def _different_names(key: str, first: Replaced, second: Replaced, terms: _Terms | None) -> str:
    """Give the names that only one of two lists has; where both have the same, the first place at which they differ."""
    a, b = ([str(name) if terms is None else terms.kind(name).name for name in x.value] for x in (first, second))
    parts = []
    for one, mine, other in ((first, a, b), (second, b, a)):
        surplus = [name for name, kind in zip(one.value, mine, strict=True) if kind not in other]
        parts += [f"{', '.join(map(str, surplus))} only in {one.source}"] if surplus else []
    if parts:
        return f"{key}: {'; '.join(parts)}"
    place = next((i for i, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))
    names = [(*x.value, "nothing")[place] for x in (first, second)]
    return f"{key}: the order differs at place {place}: {names[0]} in {first.source}, {names[1]} in {second.source}"


# --- fields that follow from others ---


def _derive(values: dict[str, Any], source: dict[str, str]) -> None:
    """Add what no source has to say, because it can be worked out."""

    def derive(name: str, value: Any, origin: str) -> None:
        if name not in values:
            values[name], source[name] = value, f"follows from {origin}"

    if "joint_names" in values:
        derive("action_joint_names", values["joint_names"], "joint_names")
    if "observation" in values:
        commands = tuple(values.get("command_names", ()))
        kinds = [term_kind(values.get(f"observation.{name}.kind", name), commands) for name in values["observation"]]
        tasks = {kind.task for kind in kinds}
        derive(
            "task_type", next((task for task in ("tracking", "piano") if task in tasks), "locomotion"), "observation"
        )
        derive("command_names", (), "observation")
        if values["task_type"] != "tracking" and is_assumed(source.get("reference_quaternion", "")):
            del values["reference_quaternion"], source["reference_quaternion"]  # of no meaning without a motion
        if all(kind.requires != "body_names" for kind in kinds):
            derive("body_names", (), "observation")


def _missing(values: Mapping[str, Any], kinds: Iterable[TermKind]) -> Iterable[str]:
    parts = {name.partition(".")[0] for name in values}
    for name in dict.fromkeys([*_REQUIRED, *(kind.requires for kind in kinds if kind.requires)]):
        if name == "phase" and "phase" in parts and values.get("phase", "") is not None:
            if "phase.period" not in values and "phase.frequency" not in values:
                yield "phase.period"
        elif name not in values or (name == "anchor_body" and not values[name]):
            yield name
    if "command" in values.get("observation", ()) and not values.get("command_names"):
        yield "command_names"


def build(values: Mapping[str, Any], source: Mapping[str, str]) -> PolicyContract:
    """Return the contract of joined fields. Raises `FieldError` if they do not fit each other."""
    plain = {name: value for name, value in values.items() if "." not in name and name not in ("observation", "phase")}
    parts: dict[str, dict[str, Any]] = {"phase": {}, "tensors": {}}
    options: dict[str, dict[str, Any]] = {name: {} for name in values["observation"]}
    for name, value in values.items():
        whole, _, part = name.partition(".")
        if whole in parts and part:
            parts[whole][part] = value
        elif whole == "observation" and part:
            term, option = _term_option(name)
            options[term][option] = value
    terms = tuple(Term(name, **{k: v for k, v in own.items() if k != "name"}) for name, own in options.items())
    if parts["phase"]:
        plain["phase"] = PhaseRule(**parts["phase"])
    return PolicyContract(**plain, observation=terms, tensors=TensorNames(**parts["tensors"]), source=source)


def _blamed(problem: str, source: Mapping[str, str]) -> str:
    """Return what does not fit, with the source of the field that it is about."""
    problem = problem.removeprefix("PolicyContract.").replace("PhaseRule.", "phase.")
    origin = source.get(problem.partition(":")[0])
    return one_line(f"{problem} ({origin})" if origin else problem)


def outline(reading: Reading) -> PolicyContract | None:
    """Return a contract with something harmless in the place of what is missing, for widths; None without terms."""
    if reading.contract is not None or {"joint_names", "observation"} & set(reading.missing):
        return reading.contract
    neutral: dict[str, Any] = {
        "joint_stiffness": 1.0,
        "joint_damping": 1.0,
        "default_joint_pos": 0.0,
        "action_scale": 1.0,
        "policy_dt": 0.02,
        "anchor_body": "?",
        "lookahead_steps": (1,),
    }
    values = {name: value for name, value in neutral.items() if name in reading.missing} | dict(reading.values)
    if any(name in reading.missing for name in ("phase", "phase.period")):
        values["phase.period"] = 1.0
    try:
        return build(values, reading.source)
    except FieldError:
        return None
