"""A checkpoint's contract as rows of a table, and the names in plots."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.observation import ObservationLayout
from humanoid_sim.controllers.terms import value_names
from humanoid_sim.policy.findings import list_joints, shown
from humanoid_sim.policy.layers import is_assumed
from humanoid_sim.policy.readers.own import flattened, plain


class Row(NamedTuple):
    """A field of a contract, or options of terms, and where they came from."""

    field: str
    value: str
    source: str


def contract_rows(values: Mapping[str, Any], source: Mapping[str, str]) -> list[Row]:
    """Return the fields that have a source, as in `Layer.values`; parts of a field, and options of terms, together."""
    parts: dict[tuple[str, str], list[str]] = {}
    for name in (name for name in values if name in source):
        owner, _, part = name.rpartition(".")
        text = f"{part} {shown(values[name])}" if owner else value_text(values[name])
        parts.setdefault((owner or name, source[name]), []).append(text)
    rows: list[Row] = []
    terms: dict[tuple[str, str], list[str]] = {}
    for (owner, origin), texts in parts.items():
        if owner.startswith("observation."):
            terms.setdefault((", ".join(texts), origin), []).append(owner.removeprefix("observation."))
        else:
            rows.append(Row(owner, ", ".join(texts), origin))
    return rows + [Row("terms", f"{text} of {', '.join(names)}", origin) for (text, origin), names in terms.items()]


def value_text(value: Any) -> str:
    """Return a field's value in few words."""
    return list_joints([str(item) for item in value]) or "none" if isinstance(value, tuple) else shown(value) or "none"


def assumptions(contract: PolicyContract) -> dict[str, str]:
    """Return the fields that no source states, with their values, by the dialect that implies them."""
    found: dict[str, list[str]] = {}
    for row in contract_rows(dict(flattened(plain(contract), "contract")), contract.source):
        if is_assumed(row.source):
            found.setdefault(row.source, []).append(f"{row.field} {row.value}")
    return {source: "; ".join(texts) for source, texts in found.items()}


def observation_labels(contract: PolicyContract, layout: ObservationLayout) -> dict[str, tuple[str, ...]]:
    """Return the joints of the values of each term that shows one value of each joint."""
    joints = {bound.name: (value_names(bound.term, contract), bound.width) for bound in layout.terms}
    return {name: names for name, (names, width) in joints.items() if len(set(names)) == width}
