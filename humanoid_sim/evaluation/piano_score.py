"""Score of a played song: per time step as RoboPianist (Zakka et al. 2023) scores it, and per note as `mir_eval` does.

Per time step: precision, recall and F1 of the keys that are down, then the mean over the steps; a ratio whose
denominator is 0 counts as 1. Per note: a stroke is right if it begins within a tolerance of a note of its key that no
other stroke has played.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import FieldError
from humanoid_sim.mit import BoolArray, FloatArray

ONSET_TOLERANCE = 0.1
"""s, between a note's start and the stroke that plays it. Twice that of transcription: a key takes time to go down."""


@dataclass(frozen=True, slots=True)
class Ratio:
    """Precision, recall and F1, 0 to 1 each."""

    precision: float
    recall: float
    f1: float


@dataclass(frozen=True, slots=True)
class PianoScore:
    """Figures of one performance."""

    steps: Ratio  # mean over the time steps
    notes: Ratio  # over all strokes and notes
    note_count: int  # notes that the song asks for
    hit_count: int  # those that were struck in time
    false_count: int  # strokes that no note asked for


class PlayedKeys:
    """The keys of one run, at the song's frames that the policy was shown, of each the first time."""

    def __init__(self, goals: npt.NDArray[np.floating], step: float) -> None:
        """Begin with goals of shape (F, K), 1 where a key should be down, one row every `step` s."""
        self._goals, self.step = np.asarray(goals) > 0.5, step
        self._pressed = np.zeros_like(self._goals)
        self._seen = np.zeros(len(self._goals), dtype=np.bool_)

    def update(self, frame: int, keys: npt.NDArray[np.floating]) -> None:
        """Take the keys, shape (K,), 1 where one is down, in the tick in which a frame is shown.

        Raises `FieldError` if their number is not the song's.
        """
        if keys.shape != self._goals.shape[1:]:
            raise FieldError(f"has {len(keys)} keys, and the song {self._goals.shape[1]}")
        if frame < len(self._seen) and not self._seen[frame]:
            self._pressed[frame], self._seen[frame] = keys > 0.5, True

    @property
    def pressed(self) -> BoolArray:
        """Shape (T, K), whether a key was down, in the T frames that were shown."""
        return self._pressed[self._seen]

    @property
    def wanted(self) -> BoolArray:
        """Shape (T, K), whether it should have been."""
        return self._goals[self._seen]


def score(
    pressed: npt.NDArray[np.floating | np.bool_],
    wanted: npt.NDArray[np.floating | np.bool_],
    step: float,
    *,
    onset_tolerance: float = ONSET_TOLERANCE,
) -> PianoScore:
    """Score a performance: shape (T, K) each, 1 where a key was down and should have been, one row every `step` s."""
    down, goal = np.asarray(pressed) > 0.5, np.asarray(wanted) > 0.5
    precision, recall, f1 = (float(ratio.mean()) for ratio in step_ratios(down, goal))
    struck, notes = _strokes(down), _strokes(goal)
    hits = _matched(struck, notes, round(onset_tolerance / step))
    counts = np.array([len(struck), len(notes), len(struck) + len(notes)])
    shares = _share(np.array([hits, hits, 2 * hits], dtype=np.float64), counts).tolist()
    return PianoScore(Ratio(precision, recall, f1), Ratio(*shares), len(notes), hits, len(struck) - hits)


def step_ratios(down: BoolArray, goal: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Precision, recall and F1, shape (...) each, of time steps: which keys are down and which should be, (..., K)."""
    right = (down & goal).sum(axis=-1).astype(np.float64)
    pressed, wanted = down.sum(axis=-1), goal.sum(axis=-1)
    return _share(right, pressed), _share(right, wanted), _share(2.0 * right, pressed + wanted)


def _share(part: FloatArray, whole: npt.NDArray[np.number]) -> FloatArray:
    return np.where(whole > 0, part / np.where(whole > 0, whole, 1), 1.0)


def _strokes(down: BoolArray) -> list[tuple[int, int]]:
    """Return where keys go down, as (step, key) in order of time; `down` is shape (T, K)."""
    before = np.vstack([np.zeros((1, down.shape[1]), dtype=np.bool_), down[:-1]])
    return [(int(step), int(key)) for step, key in np.argwhere(down & ~before)]


def _matched(struck: list[tuple[int, int]], notes: list[tuple[int, int]], tolerance: int) -> int:
    """Return how many strokes play a note: in order of time each takes the earliest of its key that it can play."""
    waiting, hits = list(notes), 0
    for step, key in struck:
        for note in waiting:
            if note[1] == key and abs(note[0] - step) <= tolerance:
                waiting.remove(note)
                hits += 1
                break
    return hits
