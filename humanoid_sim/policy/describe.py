"""A checkpoint's contract in words and plain values, for people, for other programs, and for the names in plots."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np

from humanoid_sim.controllers.contract import FORMS, PhaseRule, PolicyContract
from humanoid_sim.controllers.observation import ObservationLayout, ObservationTerm
from humanoid_sim.controllers.policy_step import ACTION_LIMIT
from humanoid_sim.controllers.term_kinds import TermKind
from humanoid_sim.controllers.terms import SCAN_OPTIONS, Term
from humanoid_sim.files import finite
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.contract_json import encode, plain_value
from humanoid_sim.policy.readers.partial import NOT_STATED, Given, is_assumed
from humanoid_sim.policy.readers.values import shown

_LISTED = 4
"""Names that are all shown; of more, the first three."""
_UNUSUAL = (
    *("frame", "at", "axes", "relative", "layout", "inverse", "quaternion", "form", "clip", "joints"),
    *SCAN_OPTIONS,
)


class TermLine(NamedTuple):
    """One observation term."""

    start: int
    """Index of its first value in the whole observation; where a step's terms lie together, in the first step."""
    width: int
    """Values, all steps of its history together."""
    name: str
    meaning: str
    conventions: str
    """Differences from the usual; empty if there are none."""
    scale: str
    history: str


class FieldLine(NamedTuple):
    """One field of the contract and where it came from."""

    name: str
    value: str
    source: str


def term_lines(contract: PolicyContract, layout: ObservationLayout) -> list[TermLine]:
    """Return the observation, term by term."""
    lines = []
    begin = 0
    for resolved in layout.terms:
        term, width = resolved.term, resolved.width
        start = resolved.start if layout.history_layout == "per_step" else begin
        history = "" if term.history == 1 else f"{term.history} steps, {term.history_order.replace('_', ' ')}"
        meaning, conventions = _meaning(contract.kind(term), term), ", ".join(_conventions(term))
        lines.append(TermLine(start, width, term.name, meaning, conventions, _numbers(term.scale), history))
        begin += width
    return lines


def _meaning(kind: TermKind, term: Term) -> str:
    if kind.topic:
        from humanoid_sim.client import LIVE_TIMEOUT  # noqa: PLC0415 - sessions need a Unix, which policies do not

        timeout = LIVE_TIMEOUT if term.timeout is None else term.timeout
        stale = "never stale" if math.isinf(timeout) else f"stale after {timeout:g} s"
        return f"{kind.meaning}; from other programs by {term.topic or kind.topic}, {stale}"
    if "relative" not in kind.conventions:
        return kind.meaning
    if kind.is_relative(term):
        return f"{kind.meaning}, less the default pose"
    return f"{kind.meaning}, absolute" if kind.relative else kind.meaning


def _conventions(term: Term) -> Iterator[str]:
    usual = Term(term.name, term.kind)
    for name in _UNUSUAL:
        value = getattr(term, name)
        if value == getattr(usual, name) or (name == "relative" and value is not None):
            continue  # whether positions are relative is part of the meaning
        if name == "clip":
            yield f"clip {value[0]:g} to {value[1]:g}"
        elif name == "joints":
            yield f"joints {', '.join(value)}"
        elif name == "inverse":
            yield "robot seen from the reference"
        else:
            yield f"{name} {shown(value)}"


def field_lines(contract: PolicyContract) -> list[FieldLine]:
    """Every field, its value and its source; options of observation terms that have one source are put together."""
    lines: list[FieldLine] = []

    def add(name: str, value: str) -> None:
        lines.append(FieldLine(name, value, contract.provenance.get(name, NOT_STATED)))

    for name in FORMS:
        if name not in ("tensors", "observation"):
            add(name, _value(name, getattr(contract, name), contract.joint_names))
        if name == "phase":
            lines += _phase_lines(contract)
    add("observation", f"{len(contract.terms)} terms")
    lines += _option_lines(contract)
    for field in fields(contract.tensors):
        name, value = f"tensors.{field.name}", getattr(contract.tensors, field.name)
        if value or name in contract.provenance:
            add(name, value or "by its place")
    return lines


def _phase_lines(contract: PolicyContract) -> Iterator[FieldLine]:
    """Yield the parts of the gait clock that are not from where the clock is, one line for each source."""
    parts: dict[str, list[str]] = {}
    for field in fields(PhaseRule) if contract.phase is not None else ():
        source = contract.provenance.get(f"phase.{field.name}", "")
        if source not in ("", contract.provenance.get("phase")):
            parts.setdefault(source, []).append(f"{field.name} {shown(getattr(contract.phase, field.name))}")
    for source, values in parts.items():
        yield FieldLine("phase", ", ".join(values), source)


def _option_lines(contract: PolicyContract) -> Iterator[FieldLine]:
    options = {name.rpartition(".")[2] for name in contract.provenance if name.startswith("observation.")}
    for option in sorted(options):
        owners: dict[str, list[str]] = {}
        for term in contract.terms:
            source = contract.provenance.get(f"observation.{term.name}.{option}")
            if source is not None:
                owners.setdefault(source, []).append(term.name)
        for source, names in owners.items():
            who = "every term" if len(names) == len(contract.terms) else ", ".join(names)
            yield FieldLine(f"terms' {option}", f"of {who}", source)


def contract_document(contract: PolicyContract, layout: ObservationLayout) -> dict[str, Any]:
    """Return the whole contract as plain JSON values, with the place of each term; null stands for infinity."""
    document: dict[str, Any] = finite(json.loads(encode(contract)))
    document.setdefault("action_clip", None)
    lines = term_lines(contract, layout)
    document["observation"] = [
        {**term, "start": line.start, "width": line.width, "meaning": line.meaning}
        for term, line in zip(document["observation"], lines, strict=True)
    ]
    document["observation_width"] = layout.width
    document["assumed"] = [name for name, source in contract.provenance.items() if is_assumed(source)]
    return document


def known_lines(known: Mapping[str, Given], terms: Mapping[str, Mapping[str, Given]]) -> list[FieldLine]:
    """Return what is known of a contract that lacks fields, as `field_lines` shows a whole one.

    Args:
        known: as in `PartialContract.fields`.
        terms: options of the observation terms, by the names in the observation.
    """
    joints = known["joint_names"].value if "joint_names" in known else ()
    lines = [FieldLine(name, _value(name, given.value, joints), given.source) for name, given in known.items()]
    return lines + [
        FieldLine(f"observation.{name}.{option}", shown(given.value), given.source)
        for name, options in terms.items()
        for option, given in options.items()
    ]


def known_document(known: Mapping[str, Given], terms: Mapping[str, Mapping[str, Given]]) -> dict[str, Any]:
    """Return the same as plain JSON values: value and source of each field, by its name; null stands for infinity."""
    options = {f"observation.{name}.{option}": given for name in terms for option, given in terms[name].items()}
    return {
        name: {"value": finite(plain_value(name, given.value)), "source": given.source}
        for name, given in {**known, **options}.items()
    }


def _value(name: str, value: Any, joint_names: tuple[str, ...]) -> str:
    if name == "action_limit" and value is None:
        value = ACTION_LIMIT
    if value is None or (isinstance(value, str | tuple) and not value):
        return "none"
    if name in _FORMATS:
        return _FORMATS[name](value)
    if name == "action_joint_names" and len(value) == len(joint_names):
        return "all joints" + ("" if value == joint_names else ", in another order")
    if isinstance(value, tuple):
        texts = [str(item) for item in value]
        return ", ".join(texts) if len(texts) <= _LISTED else f"{len(texts)}: {', '.join(texts[:3])}, …"
    return _numbers(value) if isinstance(value, np.ndarray | float) else str(value)


def _phase(rule: PhaseRule) -> str:
    offsets = ", ".join(f"{offset:.3g}" for offset in rule.offsets)
    standing = f", standing below {rule.standing_threshold:g}" if rule.standing_threshold else ""
    pace = f"period {rule.period:g} s"
    if rule.frequency is not None:
        pace = ", ".join(f"{hertz:g} Hz at {speed:g}" for speed, hertz in rule.frequency)
        pace += {"command": " of the command", "planar": " m/s", "forward": " m/s forwards"}[rule.speed]
    return f"{pace}, feet at {offsets} rad{standing}"


def _ranges(ranges: FloatArray) -> str:
    names = ("vx", "vy", "yaw rate")
    return ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in zip(names, ranges, strict=True))


_FORMATS: Mapping[str, Callable[[Any], str]] = {
    "phase": _phase,
    "command_ranges": _ranges,
    "action_clip": lambda limit: "none" if limit == math.inf else f"{limit:g}",
    "policy_dt": lambda seconds: f"{seconds:g} s ({1.0 / seconds:g} Hz)",
}


def _numbers(values: Any) -> str:
    """One number where all are the same, else how many there are and their range."""
    array = np.asarray(values)
    if (array == array.flat[0]).all():
        return f"{array.flat[0]:g}"
    return f"{array.size} values, {array.min():g} to {array.max():g}"


_AXES = ("x", "y", "z")


def observation_labels(contract: PolicyContract, layout: ObservationLayout) -> dict[str, tuple[str, ...]]:
    """By term the name of each of its values, all steps of its history together.

    A term whose values do not lie together, as in observations that are laid out step by step, has numbers.
    """
    is_scattered = layout.history_layout == "per_step" and layout.history > 1
    return {
        term.name: tuple(str(i) for i in range(term.width)) if is_scattered else _with_history(contract, term)
        for term in layout.terms
    }


def _with_history(contract: PolicyContract, term: ObservationTerm) -> tuple[str, ...]:
    names = _step_labels(contract, term)
    steps = range(term.term.history)
    if len(steps) == 1:
        return names
    ages = reversed(steps) if term.term.history_order == "oldest_first" else steps
    return tuple(f"{name}, {age} steps ago" if age else name for age in ages for name in names)


def _step_labels(contract: PolicyContract, term: ObservationTerm) -> tuple[str, ...]:
    """Return the labels of one step."""
    width = term.stop - term.start
    kind = contract.kind(term.term)
    joints = kind.value_names(term.term, contract)
    if len(joints) == width:
        half = width // 2
        if len(set(joints)) == half:  # a motion's joint positions, then their velocities
            return tuple(f"{joint} {'position' if i < half else 'velocity'}" for i, joint in enumerate(joints))
        return joints
    bodies = contract.body_names
    if kind.name.startswith("motion_body") and bodies and width % len(bodies) == 0:
        size = width // len(bodies)
        return tuple(f"{body} {part}" for body in bodies for part in _components(size))
    return tuple(_components(width, quaternion=term.term.quaternion))


def _components(count: int, quaternion: str = "wxyz") -> tuple[str, ...]:
    """Return the labels of a vector or a quaternion; numbers of anything else."""
    if count == len(_AXES):
        return _AXES
    return tuple(quaternion) if count == 4 else tuple(str(i) for i in range(count))
