"""What to write into a contract.yaml to turn one contract into another."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import numpy as np
import yaml

from humanoid_sim.controllers.contract import PhaseRule, PolicyContract
from humanoid_sim.controllers.terms import Term
from humanoid_sim.doctor.hypotheses import same_value
from humanoid_sim.policy.readers.partial import is_derived

__all__ = ["override_yaml", "overrides", "short_lines"]


def overrides(present: PolicyContract, wanted: PolicyContract) -> dict[str, Any]:
    """The fields of the section `override:`, as plain values; empty if the contracts are the same."""
    changed: dict[str, Any] = {}
    for item in fields(PolicyContract):
        before, after = getattr(present, item.name), getattr(wanted, item.name)
        if item.name in ("observation", "provenance", "tensors") or same_value(before, after):
            continue
        if item.name == "action_offset" and is_derived(present.provenance.get(item.name, "")):
            continue  # it moves along with the default pose
        changed[item.name] = _plain(after)
    if present.observation_names != wanted.observation_names:
        changed["observation"] = list(wanted.observation_names)
    before = {term.name: term for term in present.terms}
    terms = {term.name: _options(before[term.name], term) for term in wanted.terms}
    if any(terms.values()):
        changed["terms"] = {name: options for name, options in terms.items() if options}
    return changed


def override_yaml(present: PolicyContract, wanted: PolicyContract) -> str:
    """The section `override:` in full, ready to be pasted."""
    return yaml.safe_dump(
        {"override": overrides(present, wanted)},
        sort_keys=False,
        default_flow_style=None,
        width=110,
        allow_unicode=True,
    )


def short_lines(present: PolicyContract, wanted: PolicyContract) -> list[str]:
    """The same for a table: one line each, long lists cut."""
    return [f"{path}: {_short(value)}" for path, value in _flat("", overrides(present, wanted))]


def _options(before: Term, after: Term) -> dict[str, Any]:
    return {
        item.name: _plain(getattr(after, item.name))
        for item in fields(Term)
        if not same_value(getattr(before, item.name), getattr(after, item.name))
    }


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        alike = value.ndim < 2 and value.size and bool((value == value.flat[0]).all())
        return float(value.flat[0]) if alike else value.tolist()
    if isinstance(value, PhaseRule):
        return {item.name: _plain(getattr(value, item.name)) for item in fields(PhaseRule)}
    return list(value) if isinstance(value, tuple) else value


def _flat(path: str, value: Any) -> Iterator[tuple[str, Any]]:
    if not isinstance(value, dict):
        yield path, value
        return
    for name, part in value.items():
        yield from _flat(f"{path}.{name}" if path else name, part)


def _short(value: Any) -> str:
    if not isinstance(value, list):
        return (
            f"{value:g}" if isinstance(value, float) else str(value).lower() if isinstance(value, bool) else str(value)
        )
    shown = ", ".join(_short(item) for item in value[:2])
    return f"[{shown}, … {len(value)} in all]" if len(value) > 3 else f"[{', '.join(_short(item) for item in value)}]"
