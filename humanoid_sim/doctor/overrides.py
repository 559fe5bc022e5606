"""The section `override:` of a contract.yaml, whole, that turns the present contract into another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.doctor.hypotheses import differences
from humanoid_sim.policy.contract_json import plain_value
from humanoid_sim.policy.readers.contract_yaml import own_contract
from humanoid_sim.strict_yaml import read_yaml

_MANY = 3
"""Lists that have all moved from which on they are not shown one by one."""
_LINE = 110
"""Width of the YAML, in characters."""


@dataclass(frozen=True, slots=True)
class Pasting:
    """File into which to paste the doctor's output, and the values that it overrides already."""

    file: Path
    section: Mapping[str, Any] = field(default_factory=dict)
    """Present section `override:` of the file; empty without one."""

    def override(self, present: PolicyContract, wanted: PolicyContract) -> dict[str, Any]:
        """Return the whole section as plain values: what it overrides now, and the changes; no key twice."""
        changed = overrides(present, wanted)
        merged: dict[str, Any] = deepcopy(dict(self.section))
        if changed:
            # A list of terms may hold their options, and those must not be given twice.
            written = [item if isinstance(item, dict) else {"name": item} for item in merged.get("observation", ())]
            names = [item.pop("name") for item in written]
            options = dict(zip(names, written, strict=True))
            for terms in (merged.pop("terms", {}), changed.pop("terms", {})):
                for name, values in terms.items():
                    options[name] = {**options.get(name, {}), **values}
            if written:
                merged["observation"] = names
            merged |= changed
            kept = {name: values for name, values in options.items() if values}
            merged |= {"terms": kept} if kept else {}
        return merged

    def text(self, present: PolicyContract, wanted: PolicyContract) -> str:
        """Return the section as YAML, under a comment that says where it belongs."""
        place = f"in place of the section override: of {self.file}" if self.section else f"into {self.file}"
        section = yaml.safe_dump(
            {"override": self.override(present, wanted)},
            sort_keys=False,
            default_flow_style=None,
            width=_LINE,
            allow_unicode=True,
        )
        return f"# {place}\n{section}"


def pasting_for(checkpoint: Path, contract_file: Path | None) -> Pasting:
    """Return where the cure of a checkpoint belongs: the contract.yaml that took part, or, without one, its own.

    Raises `InputError` if the file cannot be read.
    """
    if contract_file is None:
        return Pasting(own_contract(checkpoint))
    document = read_yaml(contract_file)
    return Pasting(contract_file, (document or {}).get("override") or {})


def overrides(present: PolicyContract, wanted: PolicyContract) -> dict[str, Any]:
    """Give the fields of the section `override:` that change, as plain values; empty if the contracts are the same."""
    after = {term.name: term for term in wanted.terms}
    changed: dict[str, Any] = {}
    terms: dict[str, dict[str, Any]] = {}
    for name, option in differences(present, wanted):
        if option:
            terms.setdefault(name, {})[option] = _plain(option, getattr(after[name], option))
        else:
            changed[name] = _plain(name, getattr(wanted, name))
    if present.observation_names != wanted.observation_names:
        changed["observation"] = list(wanted.observation_names)
    return {**changed, "terms": terms} if terms else changed


def change_lines(present: PolicyContract, wanted: PolicyContract) -> list[str]:
    """Return what differs, one line each: the field, its value before, and after; long lists cut."""
    known, terms = dict(_flat("", overrides(wanted, present))), {term.name: term for term in present.terms}
    changed = []
    for path, after in _flat("", overrides(present, wanted)):
        before = known.get(path)
        name, _, option = path.removeprefix("terms.").rpartition(".")
        if option == "relative" and before is None:
            before = f"{_short(present.kind(terms[name]).is_relative(terms[name]))} (default)"
        if after not in (before, [before]):  # a section is overridden as a whole, what stays in it too
            changed.append((path, before, after))
    moved = {path for path, before, after in changed if _is_reordered(before, after)}
    lines = [f"{path}: {_short(before)} → {_short(after)}" for path, before, after in changed]
    if len(moved) < _MANY:
        return lines
    others = [line for line, (path, _, _) in zip(lines, changed, strict=True) if path not in moved]
    return ["all lists per joint reordered", *others]


def _is_reordered(before: Any, after: Any) -> bool:
    """Return whether two lists hold the same in another order."""
    if not isinstance(before, list) or not isinstance(after, list):
        return False
    return sorted(map(str, before)) == sorted(map(str, after))


def _plain(name: str, value: Any) -> Any:
    if isinstance(value, np.ndarray) and value.ndim < 2 and value.size and (value == value.flat[0]).all():
        return float(value.flat[0])  # one number for all
    return plain_value(name, value)


def _flat(path: str, value: Any) -> Iterator[tuple[str, Any]]:
    if not isinstance(value, dict):
        yield path, value
        return
    for name, part in value.items():
        yield from _flat(f"{path}.{name}" if path else name, part)


def _short(value: Any) -> str:
    if isinstance(value, list):
        shown = [_short(item) for item in value]
        return f"[{', '.join(shown[:2])}, … {len(shown)} in all]" if len(shown) > 3 else f"[{', '.join(shown)}]"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)
