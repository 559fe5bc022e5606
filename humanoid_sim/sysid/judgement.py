"""How well a fit predicts data that it did not see, and what it leaves unexplained."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.check_poses import Touching
from humanoid_sim.sysid.data import SETTLING, Run, Window
from humanoid_sim.sysid.fit import Fit
from humanoid_sim.sysid.model import Prediction

QUANTITIES = ("position", "velocity", "effort")
_BETTER = 0.95
"""Share of the old error that a fit must come below."""
_EXPLAINED = 1e-3, 0.02
"""rad and rad/s: errors below this are the sensors'."""
_ALIKE = 0.5
"""Correlation of neighbouring errors from which they have a cause that the model lacks."""
_TILT = 0.1
"""rad by which a base that hangs may turn."""
_POSES = 200


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """Root mean square errors of predictions, old and new, of windows that were not fitted."""

    old: FloatArray
    """Shape (3, n), rad, rad/s and N·m, in the order of `QUANTITIES`."""
    new: FloatArray
    """Likewise."""
    alike: FloatArray
    """Shape (2, n), correlation of neighbouring errors of the new prediction, of positions and velocities."""
    shown: tuple[Window, Prediction, Prediction]
    """The first window, with both predictions, for plots."""

    @property
    def ratio(self) -> FloatArray:
        """Shape (3,), the new error over the old one, each root mean square over all joints."""
        ratio: FloatArray = np.sqrt((self.new**2).sum(axis=1) / np.maximum((self.old**2).sum(axis=1), 1e-300))
        return ratio

    @property
    def is_better(self) -> bool:
        """Return whether positions and velocities are predicted better than before."""
        return bool((self.ratio[:2] <= _BETTER).all())

    def unexplained(self, joint_names: Sequence[str]) -> Iterator[str]:
        """Yield a line for each joint whose errors are larger than a sensor's, and not independent of one another."""
        for j, name in enumerate(joint_names):
            large = [self.new[i, j] > _EXPLAINED[i] and self.alike[i, j] > _ALIKE for i in range(2)]
            if any(large):
                yield (
                    f"{name}: what is left, {self.new[0, j]:.2g} rad and {self.new[1, j]:.2g} rad/s, has a structure "
                    f"(neighbouring errors correlate by {self.alike[:, j].max():.2f}): the model lacks something, such "
                    "as a mass, play or elasticity, and the fitted values make up for some of it"
                )


def judge(fit: Fit, windows: Sequence[Window]) -> Judgement:
    """Predict windows with the old and the new parameters. Raises `InputError` where there are none."""
    if not windows:
        raise InputError("recordings: leave no stretch of 2 s to judge the fit by")
    pairs = [(fit.predict(window, fit.old), fit.predict(window, fit.new)) for window in windows]
    errors = [
        [
            [_errors(window, prediction, name) for window, prediction in zip(windows, of, strict=True)]
            for name in QUANTITIES
        ]
        for of in zip(*pairs, strict=True)
    ]
    old, new = (
        np.array([np.sqrt(np.nanmean(np.concatenate(parts) ** 2, axis=0)) for parts in quantity]) for quantity in errors
    )
    alike = np.array([_correlation(parts) for parts in errors[1][:2]])
    return Judgement(old, new, alike, (windows[0], *pairs[0]))


def _errors(window: Window, prediction: Prediction, name: str) -> FloatArray:
    time = window.run.time[window.first : window.last]
    difference = getattr(prediction, name) - getattr(window.run, name)[window.first : window.last]
    settled: FloatArray = difference[time - time[0] >= SETTLING]
    return settled


def _correlation(parts: Sequence[FloatArray]) -> FloatArray:
    products = sum((part[1:] * part[:-1]).sum(axis=0) for part in parts)
    squares = sum((part**2).sum(axis=0) for part in parts)
    correlation: FloatArray = products / np.maximum(squares, 1e-300)
    return correlation


def check_runs(runs: Sequence[Run], description: RobotDescription) -> Iterator[str]:
    """Yield what an operator should know about the data.

    Raises `InputError` for a floating base that turns: in contact with the ground nothing here holds.
    """
    touching = Touching(description)
    at_rest = touching(np.array(description.initial_position))
    for run in runs:
        if description.is_floating:
            cosine = np.abs(run.quaternion @ run.quaternion[0])
            turned = 2.0 * float(np.arccos(np.clip(cosine, 0.0, 1.0)).max())
            if turned > _TILT:
                raise InputError(
                    f"{run.source}: the base turns by {turned:.2f} rad; contact is not modelled, "
                    "so legs are identified with the robot hanging still"
                )
        heard = run.position[np.isfinite(run.position).all(axis=1)]
        poses = heard[:: max(len(heard) // _POSES, 1)]
        found = [pair for pose in poses for pair in touching(pose) - at_rest]
        if found:
            first, second = found[0]
            yield f"{run.source}: {first} and {second} touch, says the model; contact is left out of the prediction"
