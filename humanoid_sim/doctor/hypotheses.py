"""The space that the doctor searches: single edits of a contract, and pairs of them.

It is bounded, and it is what goes wrong in practice: every convention that differs between exporters, turned the other
way, one at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache, partial
from itertools import combinations
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import PhaseRule, PolicyContract, TensorNames
from humanoid_sim.controllers.term_kinds import term_kind
from humanoid_sim.controllers.terms import Term
from humanoid_sim.doctor import joint_edits, observation_edits
from humanoid_sim.doctor.edits import Change, Edit, RobotFacts, set_fields, set_options

_FAMILIES: tuple[Callable[[PolicyContract, RobotFacts], Iterator[Edit]], ...] = (
    joint_edits.joint_orders,
    observation_edits.term_orders,
    observation_edits.conventions,
    observation_edits.imu_turns,
    observation_edits.reference_conventions,
    observation_edits.phases,
    observation_edits.zeroed,
    observation_edits.scales,
    joint_edits.action_scales,
    observation_edits.history_orders,
    joint_edits.default_poses,
    joint_edits.gains,
    joint_edits.group_gains,
    joint_edits.model_damping,
    joint_edits.rates,
    joint_edits.joint_signs,
    joint_edits.swapped_sides,
    joint_edits.swapped_gains,
)
_DETAIL = 4
"""As there are so many, each is less likely."""


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """A contract that may be the right one, as the present one with no, one or two edits."""

    edits: tuple[Edit, ...]
    contract: PolicyContract

    @property
    def name(self) -> str:
        """For tables."""
        return " + ".join(edit.name for edit in self.edits) or "as it is"

    @property
    def causes(self) -> tuple[str, ...]:
        """Return what the edits are about, sorted; empty for the present contract."""
        return tuple(sorted(edit.cause for edit in self.edits))

    @property
    def doubt(self) -> float:
        """Share of the cost that the edits together must save to be believed."""
        return sum(edit.doubt for edit in self.edits)

    @property
    def is_detail(self) -> bool:
        """True of edits of one joint, of which there are many."""
        return any(edit.is_detail for edit in self.edits)

    @property
    def explanation(self) -> str:
        """One line."""
        return "; ".join(edit.explanation for edit in self.edits) or "the contract as it is"


def singles(contract: PolicyContract, robot: RobotFacts) -> tuple[Hypothesis, ...]:
    """Every single edit that fits and changes something, no contract twice."""
    found = {_contract_key(contract): Hypothesis((), contract)}
    for family in _FAMILIES:
        for edit in family(contract, robot):
            changed = edit.apply(contract)
            if changed is not None:
                found.setdefault(_contract_key(changed), Hypothesis((edit,), changed))
    return tuple(found.values())[1:]


def pairs(contract: PolicyContract, promising: Sequence[Hypothesis]) -> Iterator[Hypothesis]:
    """Every two of some single edits together, most promising first; two of the same cause exclude each other.

    What is promising together has one promising half: the other may stand anywhere. So pairs go by the product of their
    halves' places; that of an edit of one joint counts `_DETAIL` times.
    """
    places = [place * (_DETAIL if edit.is_detail else 1) for place, edit in enumerate(promising, 1)]
    keys = [_contract_key(contract), *(_contract_key(hypothesis.contract) for hypothesis in promising)]
    ranked = sorted(combinations(range(len(promising)), 2), key=lambda both: places[both[0]] * places[both[1]])
    for i, j in ranked:
        first, second = promising[i].edits[0], promising[j].edits[0]
        if first.cause == second.cause:
            continue
        once = first.apply(contract)
        both = None if once is None else second.apply(once)
        if both is not None and _contract_key(both) not in (keys[0], keys[i + 1], keys[j + 1]):
            yield Hypothesis((first, second), both)


def spared(contract: PolicyContract, hypothesis: Hypothesis) -> Iterator[Hypothesis]:
    """Yield the hypothesis less one part of what it changes: a coarse edit may alter a right value as well.

    Its parts are fields of the present contract, or options of terms; a single one has no parts.
    """
    if not hypothesis.edits or any(edit.is_whole for edit in hypothesis.edits):
        return
    before, parts = {term.name: term for term in contract.terms}, dict[str, Change]()
    for name, option in differences(contract, hypothesis.contract):
        if option:
            values = {option: getattr(before[name], option)}
            parts[f"terms.{name}.{option}"] = partial(set_options, (name,), **values)
        else:
            parts[name] = set_fields(**{name: getattr(contract, name)})
    if len(parts) < 2:
        return
    *others, last = hypothesis.edits
    for part, restore in parts.items():
        explanation = f"{last.explanation}; but {part} is right as it is"
        name, doubt = f"{last.name}, but not {part}", 0.5 * last.doubt
        change = partial(_both, last.change, restore)
        edit = replace(last, name=name, explanation=explanation, change=change, doubt=doubt)
        yield Hypothesis((*others, edit), restore(hypothesis.contract))


def _both(first: Change, second: Change, contract: PolicyContract) -> PolicyContract:
    return second(first(contract))


def differences(present: PolicyContract, wanted: PolicyContract) -> Iterator[tuple[str, str]]:
    """Yield what differs, as a field and '', or a term and one of its options; the terms' order is left out."""
    for item in fields(present):
        is_one = item.name not in ("observation", "provenance", "tensors")
        if is_one and _key(getattr(present, item.name)) != _key(getattr(wanted, item.name)):
            yield item.name, ""
    before = {term.name: term for term in present.terms}
    for term in wanted.terms:
        for option in fields(Term):
            if _key(getattr(before[term.name], option.name)) != _key(getattr(term, option.name)):
                yield term.name, option.name


def same_contract(a: PolicyContract, b: PolicyContract) -> bool:
    """Compare how two contracts wire a policy; where their fields came from does not count."""
    return _contract_key(a) == _contract_key(b)


def _contract_key(contract: PolicyContract) -> Hashable:
    return tuple(_key(getattr(contract, item.name)) for item in fields(contract) if item.name != "provenance")


def _key(value: Any) -> Hashable:
    """Make the same of values that mean the same: one number stands for all, and a term says what is usual."""
    if isinstance(value, Term):
        return _term_key(value)
    if isinstance(value, PhaseRule | TensorNames):
        return tuple(_key(getattr(value, item.name)) for item in fields(value))
    if isinstance(value, np.ndarray):
        is_one = value.size > 0 and bool((value == value.flat[0]).all())
        return float(value.flat[0]) if is_one else (value.shape, (value + 0.0).tobytes())  # -0 is 0
    return tuple(map(_key, value)) if isinstance(value, tuple) else value


@lru_cache(maxsize=10_000)
def _term_key(term: Term) -> Hashable:
    options = (getattr(term, option.name) for option in fields(term) if option.name != "relative")
    return term_kind(term.kind).is_relative(term), *map(_key, options)
