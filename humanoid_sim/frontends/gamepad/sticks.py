"""From a stick's position to a velocity command."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import FloatArray

SpeedRange = npt.NDArray[np.float64]
"""Shape (3, 2): lowest and highest vx, vy (m/s) and yaw rate (rad/s), zero among them."""

_MODEST = ((-0.3, 0.5), (-0.2, 0.2), (-0.5, 0.5))
"""Speeds for a policy that does not say which it knows, as in `SpeedRange`."""


@dataclass(frozen=True, slots=True)
class Sticks:
    """Axis indices as in `sensor_msgs/Joy`, up and left being -1, and what counts as a stick at rest."""

    forward_axis: int = 1
    """Left stick, up."""
    left_axis: int = 0
    """Left stick, left."""
    turn_axis: int = 2
    """Right stick, left."""
    dead_zone: float = 0.15
    """Part of a stick's way, from its middle, that counts as none."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.dead_zone < 1.0:
            raise FieldError(f"dead_zone: is {self.dead_zone}, expected 0 or more, below 1")
        if min(self.axes) < 0:
            raise FieldError(f"axes: are {self.axes}, expected indices >= 0")

    @property
    def axes(self) -> tuple[int, int, int]:
        """Forward, left, turn."""
        return self.forward_axis, self.left_axis, self.turn_axis

    def velocity(self, axes: Sequence[float], speeds: SpeedRange) -> FloatArray:
        """Shape (3,), vx and vy in m/s and yaw rate in rad/s; an axis that the gamepad lacks is at rest.

        Beyond the dead zone the command grows linearly from zero, to the policy's limit at the end of the way.
        """
        pushed = np.array([-axes[i] if i < len(axes) else 0.0 for i in self.axes])
        beyond = np.clip((np.abs(pushed) - self.dead_zone) / (1.0 - self.dead_zone), 0.0, 1.0)
        velocity: FloatArray = np.where(pushed > 0.0, speeds[:, 1], -speeds[:, 0]) * np.sign(pushed) * beyond
        return velocity


def policy_speeds(contract: PolicyContract | None) -> SpeedRange | None:
    """Give what full sticks command of a policy; None where it takes no velocity."""
    walks = contract is not None and contract.takes_velocity_command
    return speed_range(contract.command_ranges) if walks and contract is not None else None


def speed_range(ranges: FloatArray | None) -> SpeedRange:
    """Return what full sticks command: the contract's ranges (3, 2), else modest ones."""
    known = np.array(_MODEST if ranges is None else ranges, dtype=np.float64)
    return np.stack([np.minimum(known[:, 0], 0.0), np.maximum(known[:, 1], 0.0)], axis=1)
