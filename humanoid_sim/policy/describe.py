"""A checkpoint's contract in words and plain values, for people, for other programs, and for the names in plots."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np

from humanoid_sim.client import LIVE_TIMEOUT
from humanoid_sim.controllers.contract import PolicyContract, Term
from humanoid_sim.controllers.observation import ObservationLayout
from humanoid_sim.controllers.terms import value_names
from humanoid_sim.files import finite
from humanoid_sim.policy.findings import list_joints, shown
from humanoid_sim.policy.layers import Reading, is_assumed
from humanoid_sim.policy.readers.own import plain

_OPTIONS = ("kind", "clip", "frame", "at", "layout", "inverse", "quaternion", "form", "joints", "scan")
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
    """Return every field that some source gives, and each observation term, with its place in the layout, if given."""
    sources, lines = contract.source, list[FieldLine]()
    for item in fields(contract):
        value = getattr(contract, item.name)
        is_usual = item.name == "action_joint_names" and value == contract.joint_names
        if item.name in sources and item.name != "observation" and not is_usual:
            lines.append(FieldLine(item.name, _value(item.name, value), sources[item.name]))
    for whole in ("phase", "tensors"):
        for source, parts in _parts(sources, whole).items():
            owner = getattr(contract, whole)
            text = ", ".join(f"{part} {_value(part, getattr(owner, part))}" for part in parts)
            lines.append(FieldLine(whole, text, source))
    starts = {} if layout is None else _starts(layout)
    stated = sources.get("observation", "default")
    options: dict[tuple[str, str], list[str]] = {}
    for term in contract.terms:
        lines.append(FieldLine(term.name, f"{starts.get(term.name, '')}{_term(contract, term)}", stated))
        for source, names in _parts(sources, f"observation.{term.name}").items():
            if source != stated:
                options.setdefault((", ".join(names), source), []).append(term.name)
    for (listed, source), owners in options.items():
        whose = "of every term" if len(owners) == len(contract.terms) else f"of {', '.join(owners)}"
        lines.append(FieldLine(f"terms' {listed}", whose, source))
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
    changed = {name: getattr(term, name) for name in _OPTIONS if getattr(term, name) != getattr(usual, name)}
    words += [f"{name} {shown(value)}" for name, value in changed.items()]
    if kind.topic:
        timeout = LIVE_TIMEOUT if term.timeout is None else term.timeout
        stale = "never stale" if math.isinf(timeout) else f"stale after {timeout:g} s"
        words.append(f"from other programs by {term.topic or kind.topic}, {stale}")
    return "; ".join(words)


def _value(name: str, value: Any) -> str:
    if name == "policy_dt":
        return f"{value:g} s ({1.0 / value:g} Hz)"
    if isinstance(value, np.ndarray):
        if value.size > 1 and (value == value.flat[0]).all():
            return f"{value.flat[0]:g}"
        return shown(value) if value.size <= 6 else f"{value.min():g} to {value.max():g}, {value.size} values"
    if isinstance(value, tuple):
        return list_joints([str(item) for item in value]) or "none"
    return shown(value) if value != "" else "none"


def reading_lines(reading: Reading, layout: ObservationLayout | None) -> list[FieldLine]:
    """Return what is known of a checkpoint, complete or not, with the values that others replaced."""
    if reading.contract is not None:
        lines = field_lines(reading.contract, layout)
    else:
        lines = [FieldLine(name, _value(name, value), reading.source[name]) for name, value in reading.values.items()]
    return [line._replace(replaced=_replaced(reading, line.name)) for line in lines]


def _replaced(reading: Reading, name: str) -> str:
    return "; ".join(f"{_value(name, old.value)} {old.source}" for old in reading.replaced.get(name, ()))


def document(reading: Reading, layout: ObservationLayout | None) -> dict[str, Any]:
    """Return the same as plain JSON values; null stands for infinity."""
    contract = reading.contract
    found: dict[str, Any] = {
        "contract": None if contract is None else finite(plain(contract)),
        "source": dict(reading.source),
        "assumed": [name for name, source in reading.source.items() if is_assumed(source)],
        "replaced": {name: _replaced(reading, name) for name in reading.replaced},
        "missing": list(reading.missing),
        "differences": list(reading.differences),
        "unused": list(reading.unused),
    }
    if layout is not None:
        found["observation_width"] = layout.width
        found["terms"] = [
            {"name": bound.name, "width": bound.width, "words": _term(bound.contract, bound.term)}
            for bound in layout.terms
        ]
    return found


def observation_labels(contract: PolicyContract, layout: ObservationLayout) -> dict[str, tuple[str, ...]]:
    """Return the joints of the values of each term that shows one value of each joint."""
    joints = {bound.name: (value_names(bound.term, contract), bound.width) for bound in layout.terms}
    return {name: names for name, (names, width) in joints.items() if len(set(names)) == width}
