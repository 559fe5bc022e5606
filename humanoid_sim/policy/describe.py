"""A checkpoint's contract in words and plain values, for people, for other programs, and for the names in plots."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np

from humanoid_sim.client import LIVE_TIMEOUT
from humanoid_sim.controllers.contract import PolicyContract, Term
from humanoid_sim.controllers.observation import ObservationLayout
from humanoid_sim.controllers.terms import BoundTerm, value_names
from humanoid_sim.files import finite
from humanoid_sim.policy.layers import DEFAULT, Reading, is_assumed
from humanoid_sim.policy.readers.own import encode
from humanoid_sim.policy.words import name_joints, shown

_OPTIONS = ("kind", "clip", "frame", "at", "relative", "layout", "inverse", "quaternion", "form", "joints", "scan")
"""Options of a term that are shown where they are not the usual ones."""


class FieldLine(NamedTuple):
    """One field of a contract and where it came from."""

    name: str
    value: str
    source: str
    replaced: str = ""
    """What other sources said of it."""

    @property
    def is_assumed(self) -> bool:
        """True if no source states it."""
        return is_assumed(self.source)


def field_lines(contract: PolicyContract, layout: ObservationLayout | None = None) -> list[FieldLine]:
    """Return every field that some source gives, and each observation term, with where it came from.

    Args:
        layout: of the observation, for the terms' places; None: without them.
    """
    values = {item.name: getattr(contract, item.name) for item in fields(contract) if item.name != "observation"}
    lines = [
        FieldLine(name, _value(name, value), contract.source[name])
        for name, value in values.items()
        if name in contract.source and not (name.startswith("action_joint") and value == contract.joint_names)
    ]
    for whole in ("phase", "tensors"):
        for source, parts in _parts(contract.source, whole).items():
            owner = getattr(contract, whole)
            lines.append(
                FieldLine(whole, ", ".join(f"{part} {_value(part, getattr(owner, part))}" for part in parts), source)
            )
    starts = _starts(layout) if layout is not None else {}
    stated = contract.source.get("observation", DEFAULT)
    options: dict[tuple[str, str], list[str]] = {}
    for term in contract.terms:
        lines.append(FieldLine(term.name, f"{starts.get(term.name, '')}{_term(contract, term)}", stated))
        for source, names in _parts(contract.source, f"observation.{term.name}").items():
            if source != stated:
                options.setdefault((", ".join(names), source), []).append(term.name)
    for (listed, source), owners in options.items():
        of_all = len(owners) == len(contract.terms)
        lines.append(FieldLine(f"terms' {listed}", "of every term" if of_all else f"of {', '.join(owners)}", source))
    return lines


def _parts(sources: Mapping[str, str], whole: str) -> dict[str, list[str]]:
    """Return the parts of a field by their source."""
    parts: dict[str, list[str]] = {}
    for name, source in sources.items():
        if name.startswith(f"{whole}."):
            parts.setdefault(source, []).append(name.removeprefix(f"{whole}."))
    return parts


def _starts(layout: ObservationLayout) -> dict[str, str]:
    """Return the place of each term; where a step's terms lie together, in the first step."""
    starts, begin = {}, 0
    for bound in layout.terms:
        first = bound.start if layout.history_layout == "per_step" else begin
        width = bound.stop - bound.start if layout.history_layout == "per_step" else bound.width
        starts[bound.name] = f"[{first}:{first + width}] "
        begin += bound.width
    return starts


def _term(contract: PolicyContract, term: Term) -> str:
    kind, usual = contract.kind(term), Term(term.name, term.kind, width=term.width)
    words = [kind.meaning]
    if "relative" in kind.conventions:
        words.append("less the default pose" if kind.is_relative(term) else "absolute")
    if np.any(np.not_equal(term.scale, 1.0)):
        words.append(f"scale {_value('scale', term.scale)}")
    if term.history > 1:
        words.append(f"{term.history} steps, {term.history_order.replace('_', ' ')}")
    for name in _OPTIONS:
        value = getattr(term, name)
        if name != "relative" and value != getattr(usual, name):
            words.append(f"{name} {shown(value)}")
    if kind.topic:
        timeout = LIVE_TIMEOUT if term.timeout is None else term.timeout
        stale = "never stale" if math.isinf(timeout) else f"stale after {timeout:g} s"
        words.append(f"from other programs by {term.topic or kind.topic}, {stale}")
    return "; ".join(words)


def _value(name: str, value: Any) -> str:
    if name == "policy_dt":
        return f"{value:g} s ({1.0 / value:g} Hz)"
    if isinstance(value, np.ndarray):
        if value.size == 0 or (value == value.flat[0]).all():
            return shown(value) if value.ndim == 0 or not value.size else f"{value.flat[0]:g}"
        return shown(value) if value.size <= 6 else f"{value.min():g} to {value.max():g}, {value.size} values"
    if isinstance(value, tuple):
        return name_joints([str(item) for item in value]) or "none"
    return shown(value) if value != "" else "none"


def reading_lines(reading: Reading, layout: ObservationLayout | None) -> list[FieldLine]:
    """Return what is known of a checkpoint, complete or not, with the values that others replaced."""
    if reading.contract is not None:
        lines = field_lines(reading.contract, layout)
    else:
        lines = [FieldLine(name, _value(name, value), reading.source[name]) for name, value in reading.values.items()]
    return [line._replace(replaced=_replaced(reading, line.name)) for line in lines]


def _replaced(reading: Reading, name: str) -> str:
    """Return what a line's value replaced; of numbers for each joint, where they differ most."""
    return "; ".join(f"{_value(name, old.value)} {old.source}" for old in reading.replaced.get(name, ()))


def document(reading: Reading, layout: ObservationLayout | None) -> dict[str, Any]:
    """Return the same as plain JSON values; null stands for infinity."""
    contract = reading.contract
    found: dict[str, Any] = {
        "contract": None if contract is None else finite(json.loads(encode(contract))["contract"]),
        "source": dict(reading.source),
        "assumed": [name for name, source in reading.source.items() if is_assumed(source)],
        "replaced": {name: _replaced(reading, name) for name in reading.replaced},
        "missing": list(reading.missing),
        "differences": list(reading.differences),
        "unused": list(reading.unused),
    }
    if contract is None:
        found["known"] = {name: finite(_plain(value)) for name, value in reading.values.items()}
    if layout is not None:
        found["observation_width"] = layout.width
        found["terms"] = [
            {
                "name": bound.name,
                "kind": bound.kind.name,
                "width": bound.width,
                "words": _term(bound.contract, bound.term),
            }
            for bound in layout.terms
        ]
    return found


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    return (
        list(value)
        if isinstance(value, tuple)
        else value
        if isinstance(value, str | float | int | None)
        else str(value)
    )


# --- names of single values ---


def observation_labels(contract: PolicyContract, layout: ObservationLayout) -> dict[str, tuple[str, ...]]:
    """By term the name of each of its values, all steps of its history together.

    A term whose values do not lie together, as in observations that are laid out step by step, has numbers.
    """
    is_scattered = layout.history_layout == "per_step" and layout.history > 1
    return {
        bound.name: tuple(map(str, range(bound.width))) if is_scattered else tuple(_labels(contract, bound))
        for bound in layout.terms
    }


def _labels(contract: PolicyContract, bound: BoundTerm) -> Iterator[str]:
    names = step_labels(contract, bound)
    steps = range(bound.term.history)
    for age in steps if bound.term.history_order == "newest_first" else reversed(steps):
        yield from (f"{name}, {age} steps ago" if age else name for name in names)


def step_labels(contract: PolicyContract, bound: BoundTerm) -> tuple[str, ...]:
    """Return the names of a term's values in one step: joints, axes, or numbers."""
    width = bound.stop - bound.start
    joints = value_names(bound.term, contract)
    if len(joints) == width:
        half = width // 2
        if len(set(joints)) == half:  # a motion's joint positions, then their velocities
            return tuple(f"{joint} {'position' if i < half else 'velocity'}" for i, joint in enumerate(joints))
        return joints
    bodies = contract.body_names
    if bound.kind.name.startswith("motion_body") and bodies and width % len(bodies) == 0:
        return tuple(f"{body} {part}" for body in bodies for part in _axes(width // len(bodies)))
    return tuple(_axes(width, bound.term.quaternion))


def _axes(count: int, quaternion: str = "wxyz") -> tuple[str, ...]:
    """Return the labels of a vector or a quaternion; numbers of anything else."""
    if count == 3:
        return ("x", "y", "z")
    return tuple(quaternion) if count == 4 else tuple(map(str, range(count)))
