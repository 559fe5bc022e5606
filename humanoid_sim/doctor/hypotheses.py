"""The space that the doctor searches: single edits of a contract.

It is bounded, and it is what goes wrong in practice: every convention that differs between exporters, turned the other
way, one at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import PhaseRule, PolicyContract, TensorNames
from humanoid_sim.controllers.term_kinds import term_kind
from humanoid_sim.controllers.terms import Term
from humanoid_sim.doctor import joint_edits, observation_edits
from humanoid_sim.doctor.edits import Edit, RobotFacts

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


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """A contract that may be the right one: the present one, or that with an edit."""

    edit: Edit | None
    contract: PolicyContract

    @property
    def name(self) -> str:
        """For tables."""
        return "as it is" if self.edit is None else self.edit.name

    @property
    def cause(self) -> str:
        """What the edit is about; empty for the present contract."""
        return "" if self.edit is None else self.edit.cause

    @property
    def doubt(self) -> float:
        """Share of the cost that the edit must save to be believed."""
        return 0.0 if self.edit is None else self.edit.doubt

    @property
    def explanation(self) -> str:
        """One line."""
        return "the contract as it is" if self.edit is None else self.edit.explanation


def singles(contract: PolicyContract, robot: RobotFacts) -> tuple[Hypothesis, ...]:
    """Every single edit that fits and changes something, no contract twice."""
    found = {_contract_key(contract): Hypothesis(None, contract)}
    for family in _FAMILIES:
        for edit in family(contract, robot):
            changed = edit.apply(contract)
            if changed is not None:
                found.setdefault(_contract_key(changed), Hypothesis(edit, changed))
    return tuple(found.values())[1:]


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
