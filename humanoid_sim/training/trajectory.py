"""Smooth joint trajectories: what sample motions and training motions are made of."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray

__all__ = ["derivative", "ease", "minimum_jerk_path", "smooth"]


def ease(phase: npt.ArrayLike) -> FloatArray:
    """Minimum jerk: rises from 0 at phase 0 to 1 at phase 1, at rest at both ends; constant outside."""
    s = np.clip(np.asarray(phase, dtype=np.float64), 0.0, 1.0)
    risen: FloatArray = s * s * s * (10.0 + s * (6.0 * s - 15.0))
    return risen


def minimum_jerk_path(times: FloatArray, points: FloatArray, period: float) -> FloatArray:
    """From point to point, at rest at each of them.

    Args:
        times: shape (k,), s, increasing from 0; two equal points in a row are a pause.
        points: shape (k, n).
        period: s between samples.

    Returns:
        Shape (F, n), from time 0 to the last one inclusive.
    """
    t = np.arange(round(times[-1] / period) + 1) * period
    path = np.repeat(points[:1], len(t), axis=0)
    for start, stop, step in zip(times[:-1], times[1:], np.diff(points, axis=0), strict=True):
        path = path + ease((t - start) / (stop - start))[:, None] * step
    return path


def smooth(path: FloatArray, window: int) -> FloatArray:
    """A path (F, n) averaged under a Hann window of `window` samples; it stays where it is beyond its ends."""
    weights = np.hanning(window + 2)[1:-1]
    weights /= weights.sum()
    padded = np.concatenate([np.repeat(path[:1], window, axis=0), path, np.repeat(path[-1:], window, axis=0)])
    averaged = np.stack([np.convolve(column, weights, mode="same") for column in padded.T], axis=-1)
    return averaged[window:-window]


def derivative(path: FloatArray, period: float) -> FloatArray:
    """Central differences along the first axis of (F, ...), one-sided at the ends, per second."""
    rate: FloatArray = np.gradient(path, period, axis=0)
    return rate
