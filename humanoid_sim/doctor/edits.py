"""One change to a contract that may be the cure, and the helpers that make such changes."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.terms import Term
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import FloatArray

Change = Callable[[PolicyContract], PolicyContract]

DOUBT = 0.05
"""Share of the cost that an edit must save to be believed: of two that do equally well the simpler is the likelier."""
STRONG_DOUBT = 0.25
"""Doubt about gains and gaits: others may suit a robot better without being those that its policy was trained with."""
RATE_DOUBT = 0.10
"""Doubt about rates: a policy hardly ever does clearly better at a rate that it was not trained for."""
JOINT_DOUBT = 0.10
"""Doubt about single joints: there are so many that one may suit by chance."""
LIMBS = {
    "legs": "hip|knee|ankle|leg|thigh|shin|calf|foot|toe",
    "ankles": "ankle|foot",
    "waist": "waist|torso|spine|trunk|abdomen",
    "arms": "shoulder|elbow|wrist|arm|hand",
}
"""Patterns of the joints' names, which nearly every humanoid keeps to."""
_SIDES = (("left", "right"), ("Left", "Right"), ("LL", "LR"), ("L_", "R_"), ("l_", "r_"), ("_L", "_R"), ("_l", "_r"))


@dataclass(frozen=True, slots=True, eq=False)
class RobotFacts:
    """Facts about the robot and the motion that the hypotheses need."""

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
    initial_position: FloatArray
    """Shape (n,), rad, likewise."""
    own_damping: Mapping[str, float] = field(default_factory=dict)
    """Damping in the robot's own model, N·m·s/rad by joint."""
    motion_bodies: tuple[str, ...] = ()
    """Bodies whose world poses the motion holds."""
    points: tuple[str, ...] = ()
    """Sites whose velocity a policy may observe: those on the base, and those named like an IMU."""


@dataclass(frozen=True, slots=True)
class Edit:
    """One hypothesis about what is wrong: a change, what it is about, and what it means."""

    name: str
    """Unique, short, for tables."""
    cause: str
    """Subject of the change; edits of the same cause are alternatives, of which the report shows the best."""
    explanation: str
    """One line that a user can check against the training configuration."""
    change: Change
    doubt: float = DOUBT

    def apply(self, contract: PolicyContract) -> PolicyContract | None:
        """Return the changed contract; None where the change does not fit."""
        try:
            return self.change(contract)
        except FieldError:
            return None


def limb(pattern: str, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the joints of a limb, by the pattern that `LIMBS` has for it."""
    return tuple(name for name in names if re.search(pattern, name, re.IGNORECASE))


def mirrored(names: tuple[str, ...]) -> dict[str, str]:
    """Each joint's counterpart on the other side; joints without one are left out."""
    found: dict[str, str] = {}
    for name in names:
        for left, right in _SIDES:
            other = name.replace(left, right, 1)
            if other != name and other in names and not {name, other} & found.keys():
                found |= {name: other, other: name}
    return found


def terms_with(contract: PolicyContract, convention: str) -> tuple[Term, ...]:
    """Return the terms whose values depend on a convention, in the contract's order."""
    return tuple(term for term in contract.terms if convention in contract.kind(term).conventions)


def change_terms(contract: PolicyContract, change: Callable[[Term], Term]) -> PolicyContract:
    """Every term passed through `change`."""
    return replace(contract, observation=tuple(change(term) for term in contract.terms))


def set_options(names: Collection[str], contract: PolicyContract, **options: Any) -> PolicyContract:
    """Set options of the terms with these names."""
    return change_terms(contract, lambda term: replace(term, **options) if term.name in names else term)


def term_edit(term: Term, title: str, about: str, explanation: str, **options: Any) -> Edit:
    """Options of one term set anew. Name and cause are the term's name and what follows it: `title` with its space."""
    return Edit(
        f"{term.name}{title}", f"{term.name} {about}", explanation, partial(set_options, (term.name,), **options)
    )


def set_fields(**fields: Any) -> Change:
    """Return a change that sets fields of the contract."""
    return lambda contract: replace(contract, **fields)
