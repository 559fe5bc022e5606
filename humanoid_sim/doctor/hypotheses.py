"""The space that the doctor searches: single edits of a contract, and pairs of them.

It is bounded, and it is what goes wrong in practice: every convention that differs between exporters, turned the other
way, one at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from itertools import combinations
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import PhaseRule, PolicyContract
from humanoid_sim.controllers.term_kinds import term_kind
from humanoid_sim.controllers.terms import Term
from humanoid_sim.doctor.action_edits import action_scales, default_poses, gains, group_gains, model_damping, rates
from humanoid_sim.doctor.edits import Change, Edit, RobotFacts, change_terms
from humanoid_sim.doctor.observation_edits import conventions, phases, reference_conventions, scales, zeroed
from humanoid_sim.doctor.order_edits import history_orders, joint_orders, term_orders

__all__ = ["Hypothesis", "pairs", "present", "same_contract", "same_value", "singles", "spared"]

_FAMILIES: tuple[Callable[[PolicyContract, RobotFacts], Iterator[Edit]], ...] = (
    joint_orders,
    term_orders,
    conventions,
    reference_conventions,
    phases,
    zeroed,
    scales,
    action_scales,
    history_orders,
    default_poses,
    gains,
    group_gains,
    model_damping,
    rates,
)


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
        """What the edits are about, sorted; empty for the present contract."""
        return tuple(sorted(edit.cause for edit in self.edits))

    @property
    def doubt(self) -> float:
        """Share of the cost that the edits together must save to be believed."""
        return sum(edit.doubt for edit in self.edits)

    @property
    def explanation(self) -> str:
        """One line."""
        return "; ".join(edit.explanation for edit in self.edits) or "the contract as it is"


def present(contract: PolicyContract) -> Hypothesis:
    """Hypothesis 0: nothing is wrong."""
    return Hypothesis((), contract)


def singles(contract: PolicyContract, robot: RobotFacts) -> tuple[Hypothesis, ...]:
    """Every single edit that fits and changes something, no contract twice."""
    found: list[Hypothesis] = []
    for family in _FAMILIES:
        for edit in family(contract, robot):
            changed = edit.apply(contract)
            if changed is not None and not _is_known(changed, [present(contract), *found]):
                found.append(Hypothesis((edit,), changed))
    return tuple(found)


def pairs(contract: PolicyContract, promising: Sequence[Hypothesis]) -> Iterator[Hypothesis]:
    """Every two of some single edits together, most promising first; two of the same cause exclude each other.

    What is promising together has one promising half: the other may stand anywhere.

    Args:
        contract: the present one.
        promising: single edits, best first.
    """
    ranked = sorted(combinations(range(len(promising)), 2), key=lambda both: (both[0] + 1) * (both[1] + 1))
    for i, j in ranked:
        first, second = promising[i].edits[0], promising[j].edits[0]
        if first.cause == second.cause:
            continue
        once = first.apply(contract)
        both = None if once is None else second.apply(once)
        if both is not None and not _is_known(both, (promising[i], promising[j], present(contract))):
            yield Hypothesis((first, second), both)


def spared(contract: PolicyContract, hypothesis: Hypothesis) -> Iterator[Hypothesis]:
    """The hypothesis less one part of what it changes, for each part: a coarse edit may alter a right value as well.

    Args:
        contract: the present one, whose values the parts keep.
        hypothesis: whose edits change several fields, or options of several terms; others have no parts.
    """
    if not hypothesis.edits or any(edit.is_whole for edit in hypothesis.edits):
        return
    changed = hypothesis.contract
    names = [item.name for item in fields(contract) if item.name not in ("observation", "provenance", "tensors")]
    parts = [
        (name, _with_field(name, getattr(contract, name))) for name in names if not _agree(contract, changed, name)
    ]
    before = {term.name: term for term in contract.terms}
    for term in changed.terms:
        for option in fields(Term):
            if not _agree(before[term.name], term, option.name):
                value = getattr(before[term.name], option.name)
                parts.append((f"terms.{term.name}.{option.name}", _with_option(term.name, option.name, value)))
    if len(parts) < 2:
        return
    *others, last = hypothesis.edits
    for part, restore in parts:
        edit = replace(
            last,
            name=f"{last.name}, but not {part}",
            explanation=f"{last.explanation}; but {part} is right as it is",
            change=_in_turn(last.change, restore),
            doubt=0.5 * last.doubt,
        )
        yield Hypothesis((*others, edit), restore(changed))


def _with_field(name: str, value: Any) -> Change:
    return lambda contract: replace(contract, **{name: value})


def _with_option(name: str, option: str, value: Any) -> Change:
    return lambda contract: change_terms(
        contract, lambda term: replace(term, **{option: value}) if term.name == name else term
    )


def _in_turn(first: Change, second: Change) -> Change:
    return lambda contract: second(first(contract))


def _agree(a: object, b: object, name: str) -> bool:
    return same_value(getattr(a, name), getattr(b, name))


def same_contract(a: PolicyContract, b: PolicyContract) -> bool:
    """Whether two contracts wire a policy alike; where their fields came from does not count."""
    return all(
        same_value(getattr(a, item.name), getattr(b, item.name)) for item in fields(a) if item.name != "provenance"
    )


def _is_known(contract: PolicyContract, known: Iterable[Hypothesis]) -> bool:
    return any(same_contract(contract, hypothesis.contract) for hypothesis in known)


def same_value(a: object, b: object) -> bool:
    """Whether two values of a field, or of a term's option, mean the same."""
    if isinstance(a, Term) and isinstance(b, Term):
        kind = term_kind(a.kind)
        if kind.is_relative(a) == kind.is_relative(b):
            b = replace(b, relative=a.relative)  # what is not said counts as its usual meaning
    if isinstance(a, Term | PhaseRule):
        return type(a) is type(b) and all(same_value(getattr(a, x.name), getattr(b, x.name)) for x in fields(a))
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return a is not None and b is not None and _same_values(np.asarray(a), np.asarray(b))
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(same_value(x, y) for x, y in zip(a, b, strict=True))
    return bool(a == b)


def _same_values(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two arrays say the same; one number stands for all."""
    return (a.shape == b.shape or 1 in (a.size, b.size)) and bool(np.all(a == b))
