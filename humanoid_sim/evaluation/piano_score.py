"""Score of a played song, as RoboPianist (Zakka et al. 2023) scores it: precision, recall and F1 of each time step."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import FieldError
from humanoid_sim.mit import BoolArray, FloatArray
from humanoid_sim.policy.motion import Motion


class PlayedKeys:
    """The keys of one run, at the song's frames that the policy was shown, of each the first time."""

    def __init__(self, goals: npt.NDArray[np.floating]) -> None:
        """Begin with goals of shape (F, K), 1 where a key should be down."""
        self._goals = np.asarray(goals) > 0.5
        self._pressed: dict[int, BoolArray] = {}

    def update(self, frame: int, keys: npt.NDArray[np.floating]) -> None:
        """Add the keys, shape (K,), 1 where one is down, of the tick in which a frame is shown."""
        if keys.shape != self._goals.shape[1:]:
            raise FieldError(f"has {len(keys)} keys, and the song {self._goals.shape[1]}")
        if frame < len(self._goals):
            self._pressed.setdefault(frame, keys > 0.5)

    def score(self) -> dict[str, float] | None:
        """Return `precision`, `recall` and `f1`, the means over all frames that were shown; None without any."""
        if not self._pressed:
            return None
        ratios = step_ratios(np.array(list(self._pressed.values())), self._goals[list(self._pressed)])
        return {name: float(ratio.mean()) for name, ratio in zip(("precision", "recall", "f1"), ratios, strict=True)}


def song_keys(motion: Motion | None) -> PlayedKeys | None:
    """Return an empty score of a run that follows this motion; None if the motion is not a song."""
    return PlayedKeys(motion.frames) if motion is not None and motion.task_type == "piano" else None


def step_ratios(down: BoolArray, goal: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Precision, recall and F1, shape (...) each, of time steps: which keys are down and which should be, (..., K).

    A ratio whose denominator is 0 counts as 1.
    """
    right, pressed, wanted = (down & goal).sum(axis=-1), down.sum(axis=-1), goal.sum(axis=-1)
    return _share(right, pressed), _share(right, wanted), _share(2 * right, pressed + wanted)


def _share(part: npt.NDArray[np.integer], whole: npt.NDArray[np.integer]) -> FloatArray:
    return np.where(whole > 0, part / np.where(whole > 0, whole, 1), 1.0)
