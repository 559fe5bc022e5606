"""Gait phase: a clock of the policy's own, one angle per foot."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from humanoid_sim.controllers.parameters import number
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import FloatArray, frozen_array

__all__ = ["PhaseRule", "advance_phase"]


@dataclass(frozen=True, slots=True, eq=False)
class PhaseRule:
    """How the phase moves from one policy step to the next."""

    period: float
    """s of one gait cycle."""
    offsets: FloatArray = field(default_factory=lambda: np.array([0.0, np.pi]))
    """Shape (k,), rad, of the k feet at activation."""
    advance_first: bool = True
    """The first observation shows the phase one step on, not the offsets themselves."""
    standing_threshold: float = 0.0
    """Magnitude of the velocity command below which the robot stands; 0: it never does."""
    standing_value: float | None = np.pi
    """rad, shown for every foot while standing; None: sine and cosine are both 0."""
    standing_restarts: bool = True
    """Walking on starts from the offsets again; false: the clock runs on while the robot stands."""

    def __post_init__(self) -> None:
        owner = "PhaseRule"
        set_field = object.__setattr__
        set_field(self, "period", number(owner, "period", self.period, above=True))
        offsets = frozen_array(owner, "offsets", self.offsets)
        if offsets.ndim != 1 or not offsets.size or not np.isfinite(offsets).all():
            raise FieldError(f"{owner}.offsets: is {self.offsets}, expected one finite angle per foot")
        set_field(self, "offsets", offsets)
        set_field(self, "standing_threshold", number(owner, "standing_threshold", self.standing_threshold))
        if self.standing_value is not None:
            set_field(self, "standing_value", number(owner, "standing_value", self.standing_value, minimum=-np.inf))


def advance_phase(
    rule: PhaseRule, walked: FloatArray | float, command: FloatArray, policy_dt: float
) -> tuple[FloatArray, FloatArray]:
    """One policy step.

    Args:
        rule: of the policy.
        walked: shape (...), rad walked since activation, or since standing; 0 at activation.
        command: shape (..., 3), the velocity command.
        policy_dt: s.

    Returns:
        `walked` of the next step, shape (...), and the phase to show now, shape (..., k), rad in [-π, π), or the
        standing value; NaN where that is None.
    """
    step = 2.0 * np.pi * policy_dt / rule.period
    magnitude = np.sqrt(command[..., 0] ** 2 + command[..., 1] ** 2 + command[..., 2] ** 2)
    standing = magnitude < rule.standing_threshold
    moved = np.asarray(walked) + step
    shown = moved if rule.advance_first else np.asarray(walked)
    phase = np.mod(shown[..., None] + rule.offsets + np.pi, 2.0 * np.pi) - np.pi
    phase = np.where(standing[..., None], np.nan if rule.standing_value is None else rule.standing_value, phase)
    return np.where(standing & rule.standing_restarts, 0.0, moved), phase
