"""One change to a contract that may be the cure, and the helpers that make such changes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.terms import Term
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import FloatArray

__all__ = [
    "DOUBT",
    "RATE_DOUBT",
    "STRONG_DOUBT",
    "Change",
    "Edit",
    "RobotFacts",
    "change_terms",
    "set_fields",
    "term_edit",
    "terms_with",
]

Change = Callable[[PolicyContract], PolicyContract]

DOUBT = 0.05
"""Share of the cost that an edit must save to be believed: of two that do equally well the simpler is the likelier."""
STRONG_DOUBT = 0.25
"""Of gains and gaits: other ones may suit a robot better without being what its policy was trained with."""
RATE_DOUBT = 0.10
"""Of rates: a policy hardly ever does clearly better at a rate that it was not trained for."""


@dataclass(frozen=True, slots=True, eq=False)
class RobotFacts:
    """What the hypotheses need to know about the robot and the motion."""

    joint_names: tuple[str, ...]
    """In the robot's own order, that of its MJCF."""
    breadth_first: tuple[str, ...]
    """The same joints level by level through the kinematic tree, as Isaac orders them."""
    effort_limit: FloatArray
    """Shape (n,), N·m, the robot's order; infinite where it has none."""
    stiffness: FloatArray
    """Shape (n,), N·m/rad, the robot's own gains, in its order; zeros if it has none."""
    damping: FloatArray
    """Shape (n,), N·m·s/rad, likewise."""
    poses: dict[str, FloatArray] = field(default_factory=dict)
    """Poses of the robot by name, each of shape (n,), rad, its order."""
    own_damping: Mapping[str, float] = field(default_factory=dict)
    """N·m·s/rad by joint, that the robot's model has itself."""
    motion_bodies: tuple[str, ...] = ()
    """Bodies whose world poses the motion holds."""


@dataclass(frozen=True, slots=True)
class Edit:
    """One hypothesis about what is wrong: a change, what it is about, and what it means."""

    name: str
    """Unique, short, for tables."""
    cause: str
    """What it is about; edits of the same cause are alternatives, of which the report shows the best."""
    explanation: str
    """One line that a user can check against the training configuration."""
    change: Change
    doubt: float = DOUBT
    is_whole: bool = False
    """Its parts mean nothing one by one: names and values of a new order."""

    def apply(self, contract: PolicyContract) -> PolicyContract | None:
        """The changed contract; None where the change does not fit."""
        try:
            return self.change(contract)
        except FieldError:
            return None


def terms_with(contract: PolicyContract, convention: str) -> tuple[Term, ...]:
    """The terms whose values depend on a convention, in the contract's order."""
    return tuple(term for term in contract.terms if convention in contract.kind(term).conventions)


def change_terms(contract: PolicyContract, change: Callable[[Term], Term]) -> PolicyContract:
    """Every term passed through `change`."""
    return replace(contract, observation=tuple(change(term) for term in contract.terms))


def term_edit(term: Term, title: str, about: str, explanation: str, **options: Any) -> Edit:
    """Options of one term set anew. Name and cause are the term's name and what follows it: `title` with its space."""

    def change(contract: PolicyContract) -> PolicyContract:
        return change_terms(contract, lambda other: replace(other, **options) if other.name == term.name else other)

    return Edit(f"{term.name}{title}", f"{term.name} {about}", explanation, change)


def set_fields(**fields: Any) -> Change:
    """A change that sets fields of the contract."""
    return lambda contract: replace(contract, **fields)
