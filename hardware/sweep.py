"""A joint's homing offset from a sweep by hand from one stop to the other. Pure functions.

What is swept is the joint's angle as the motor alone would have it, `direction · motor`, without an offset.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from humanoid_sim.robots.schema import JointDescription

__all__ = ["Sweep", "SweepResult", "Verdict", "evaluate"]

_TOUCH = 0.05
"""rad of overlap that is none: a joint whose range ends at zero touches its mirror image there."""


class Verdict(Enum):
    """What a sweep tells."""

    UNSWEPT = "unswept"
    """Less than the threshold: the joint keeps its previous offset."""
    GOOD = "good"
    INCOMPLETE = "partial"
    """Shorter than the joint's range: not both stops were reached, or they are nearer than the limits."""
    BEYOND = "beyond"
    """Longer than the joint's range: its stops are farther than its limits, or two motors answer as one."""
    FLIPPED = "flipped"
    """Where the joint cannot be: its `direction` is wrong in the robot description, or its motor sits elsewhere."""


@dataclass(frozen=True, slots=True)
class Sweep:
    """Lowest and highest angle seen, rad; NaN before the first."""

    lowest: float = math.nan
    highest: float = math.nan

    @property
    def width(self) -> float:
        """The angle swept, rad; 0 before the first."""
        return 0.0 if math.isnan(self.lowest) else self.highest - self.lowest

    def with_angle(self, angle: float) -> Sweep:
        """The sweep with another angle in it, rad; one that is not finite changes nothing."""
        if not math.isfinite(angle):
            return self
        if math.isnan(self.lowest):
            return Sweep(angle, angle)
        return Sweep(min(self.lowest, angle), max(self.highest, angle))


@dataclass(frozen=True, slots=True)
class SweepResult:
    """What became of one joint."""

    verdict: Verdict
    width: float
    """rad swept."""
    homing_offset: float | None
    """rad, motor frame; none unless the verdict is GOOD."""


def evaluate(
    joint: JointDescription, direction: int, sweep: Sweep, *, threshold: float, tolerance: float, any_offset: bool
) -> SweepResult:
    """What a sweep says of a joint with limits.

    `homing_offset = ½ · ((lowest - lower) + (highest - upper)) · direction`, after the sweep was moved by whole turns
    to where its middle is nearest to that of the limits: since it was switched on, a motor does not know its turn.

    Args:
        joint: whose limits are its stops.
        direction: ±1, of its motor.
        sweep: what was seen.
        threshold: rad; less is no sweep.
        tolerance: rad by which a sweep may differ from the joint's range; the offset may be wrong by half of it.
        any_offset: do not conclude from a sweep outside the joint's limits that its direction is flipped: for motors
            that were assembled without setting their zero.
    """
    width = sweep.width
    if width < threshold:
        return SweepResult(Verdict.UNSWEPT, width, None)
    offset = 0.5 * ((sweep.lowest - joint.lower) + (sweep.highest - joint.upper))
    nearest = math.remainder(offset, 2.0 * math.pi)
    lowest, highest = sweep.lowest + nearest - offset, sweep.highest + nearest - offset
    overlap = min(highest, joint.upper) - max(lowest, joint.lower)
    if not any_offset and overlap <= min(_TOUCH, 0.5 * width):
        return SweepResult(Verdict.FLIPPED, width, None)
    excess = width - (joint.upper - joint.lower)
    if abs(excess) > tolerance:
        return SweepResult(Verdict.BEYOND if excess > 0.0 else Verdict.INCOMPLETE, width, None)
    return SweepResult(Verdict.GOOD, width, nearest * direction)
