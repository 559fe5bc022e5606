"""Score of a played song, as RoboPianist (Zakka et al. 2023) scores it: precision, recall and F1 of each time step."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import BoolArray, FloatArray


def step_ratios(down: BoolArray, goal: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Precision, recall and F1, shape (...) each, of time steps: which keys are down and which should be, (..., K).

    A ratio whose denominator is 0 counts as 1.
    """
    right, pressed, wanted = (down & goal).sum(axis=-1), down.sum(axis=-1), goal.sum(axis=-1)
    return _share(right, pressed), _share(right, wanted), _share(2 * right, pressed + wanted)


def _share(part: npt.NDArray[np.integer], whole: npt.NDArray[np.integer]) -> FloatArray:
    return np.where(whole > 0, part / np.where(whole > 0, whole, 1), 1.0)
