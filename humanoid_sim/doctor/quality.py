"""How well a policy does while it stays up, in one number, and how hard it drives the joints.

Nothing here depends on the contract that is being tried: what is measured is the robot in the world.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from humanoid_sim.mit import FloatArray, MITCommand, MITState

__all__ = ["Quality", "Strain"]


@dataclass(frozen=True, slots=True)
class Quality:
    """What a run's quality is made of; each part is about 1 where an onlooker would begin to notice."""

    parts: Mapping[str, float]

    @property
    def cost(self) -> float:
        """The parts' sum: smaller is better."""
        return sum(self.parts.values())


class Strain:
    """How hard the joints are driven: a wrong wiring that stays up shakes and strains."""

    _SHAKING = 5.0
    """rad/s, root mean square of the commanded positions' change."""
    _TORQUE = 15.0
    """N·m, root mean square."""

    def __init__(self, policy_dt: float) -> None:
        self._period = policy_dt
        self._last: FloatArray | None = None
        self._change = 0.0
        self._torque = 0.0
        self._count = 0

    def update(self, state: MITState, command: MITCommand) -> None:
        """Take in one policy step."""
        if self._last is not None:
            self._change += float(((command.position - self._last) ** 2).mean())
        self._torque += float((state.joint_effort**2).mean())
        self._last = command.position
        self._count += 1

    def parts(self) -> dict[str, float]:
        """As parts of the quality."""
        count = max(self._count, 1)
        return {
            "shaking": math.sqrt(self._change / count) / self._period / self._SHAKING,
            "torque": math.sqrt(self._torque / count) / self._TORQUE,
        }
