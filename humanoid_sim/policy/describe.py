"""A checkpoint's contract as rows of a table, and the names in plots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract, Term
from humanoid_sim.controllers.observation import ObservationLayout
from humanoid_sim.controllers.terms import value_names
from humanoid_sim.policy.findings import list_joints, shown
from humanoid_sim.policy.layers import Reading, is_assumed


class Row(NamedTuple):
    """One field of a contract and where it came from."""

    field: str
    value: str
    source: str


def contract_rows(contract: PolicyContract, layout: ObservationLayout | None = None) -> list[Row]:
    """Return every field that some source gives, and each observation term, with its place in the layout, if given."""
    sources, rows = contract.source, list[Row]()
    for name in (item.name for item in fields(contract) if item.name in sources and item.name != "observation"):
        value = getattr(contract, name)
        if name != "action_joint_names" or value != contract.joint_names:
            rows.append(Row(name, value_text(name, value), sources[name]))
    for whole in ("phase", "tensors"):
        owner = getattr(contract, whole)
        for source, parts in _parts(sources, whole).items():
            rows.append(Row(whole, ", ".join(f"{part} {shown(getattr(owner, part))}" for part in parts), source))
    starts = {} if layout is None else _starts(layout)
    stated = sources.get("observation", "default")
    options: dict[Row, list[str]] = {}
    for term in contract.terms:
        rows.append(Row(term.name, starts.get(term.name, "") + _words(contract, term), stated))
        for source, names in _parts(sources, f"observation.{term.name}").items():
            if source != stated:
                options.setdefault(Row(f"terms' {', '.join(names)}", "", source), []).append(term.name)
    for row, terms in options.items():
        rows.append(row._replace(value=f"of {', '.join(terms) if len(terms) < len(contract.terms) else 'every term'}"))
    return rows


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


def _words(contract: PolicyContract, term: Term) -> str:
    """Return what a term means, and the options that are not the usual ones."""
    usual = Term(term.name, width=term.width)
    options = {item.name: getattr(term, item.name) for item in fields(term) if item.name != "name"}
    changed = {name: value for name, value in options.items() if np.any(np.not_equal(value, getattr(usual, name)))}
    return "; ".join([contract.kind(term).meaning, *(f"{name} {shown(value)}" for name, value in changed.items())])


def value_text(name: str, value: Any) -> str:
    """Return a field's value in few words."""
    if name == "policy_dt":
        return f"{value:g} s ({1.0 / value:g} Hz)"
    if isinstance(value, np.ndarray) and value.size > 6 and np.ptp(value) > 0.0:
        return f"{value.min():g} to {value.max():g}, {value.size} values"
    if isinstance(value, tuple):
        return list_joints([str(item) for item in value]) or "none"
    return shown(value) or "none"


def reading_rows(reading: Reading, layout: ObservationLayout | None) -> list[Row]:
    """Return what is known of a checkpoint, complete or not; behind its source, the values that one replaced."""
    rows = [Row(name, value_text(name, value), reading.source[name]) for name, value in reading.values.items()]
    if reading.contract is not None:
        rows = contract_rows(reading.contract, layout)
    replaced = replaced_values(reading)
    return [
        row._replace(source=f"{row.source} (replaces {replaced[row.field]})") if row.field in replaced else row
        for row in rows
    ]


def replaced_values(reading: Reading) -> dict[str, str]:
    """Return by field what other sources said of it."""
    return {
        name: "; ".join(f"{value_text(name, value)} {source}" for value, source in statements)
        for name, statements in reading.replaced.items()
    }


def assumptions(contract: PolicyContract) -> dict[str, str]:
    """Return the fields that no source states, with their values, by the dialect that implies them."""
    found: dict[str, str] = {}
    for row in contract_rows(contract):
        if is_assumed(row.source):
            before = f"{found[row.source]}; " if row.source in found else ""
            found[row.source] = f"{before}{row.field} {row.value}"
    return found


def observation_labels(contract: PolicyContract, layout: ObservationLayout) -> dict[str, tuple[str, ...]]:
    """Return the joints of the values of each term that shows one value of each joint."""
    joints = {bound.name: (value_names(bound.term, contract), bound.width) for bound in layout.terms}
    return {name: names for name, (names, width) in joints.items() if len(set(names)) == width}
