"""Pushes: at regular times the base is given a velocity in a direction that is drawn."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray
from humanoid_sim.regress.suite import Pushes
from humanoid_sim.simulation.batch import BatchSimulation

__all__ = ["PushSchedule"]

_STREAM = 1
"""Apart from the draws of the start, which have the same seed."""


class PushSchedule:
    """The wrenches of a batch's pushes: momentum for the robot's whole mass, spread over one policy step."""

    def __init__(self, pushes: Pushes, simulation: BatchSimulation, keys: npt.NDArray[np.uint64]) -> None:
        """Draw nothing yet; each push draws its own direction."""
        period = simulation.control_period
        masses = np.array([simulation.model(i).body_subtreemass[0] for i in range(simulation.count)])
        self._force = masses * pushes.speed / period
        self._interval = max(round(pushes.interval / period), 1)
        self._generators = [np.random.default_rng([_STREAM, int(key)]) for key in keys]

    def wrench(self, step: int) -> FloatArray | None:
        """Shape (N, 6), N and N·m, world frame, for one policy step, each asked for once; None where none is pushed."""
        if (step + self._interval // 2) % self._interval:
            return None
        angle = np.array([generator.uniform(-np.pi, np.pi) for generator in self._generators])
        wrench = np.zeros((len(angle), 6))
        wrench[:, 0], wrench[:, 1] = self._force * np.cos(angle), self._force * np.sin(angle)
        return wrench
