"""The implicit plant against the affine one: how much faster training's environments are with it, and how far off."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from humanoid_sim.envs.scenario import make_scenario
from humanoid_sim.simulation.plant import BatchActuation
from tools.bench.accuracy import commanded_motion, plant_errors
from tools.bench.timing import Row, paired_ratio

__all__ = ["implicit_plant"]

_WANTED = {"LiteTracking-v0": 4.0, "BipedVelocity-v0": 3.0}
"""Steps per second of the implicit plant at its own step over those of the affine one at the robot's."""
_MANY = 512
_STEPS = 2
"""Vector steps that are timed together."""
_SPREAD = 0.1
"""Magnitude of the raw actions: small, so that nothing falls meanwhile."""
_SECONDS = 2.0
"""Length of the motion whose error is measured."""


def implicit_plant(repetitions: int) -> list[Row]:
    """Speed in each environment, and the error of the Lite's hands beside it."""
    return [*(_speed(name, wanted, repetitions) for name, wanted in _WANTED.items()), _error()]


def _speed(name: str, wanted: float, repetitions: int) -> Row:
    implicit, affine = _Stepped(name, "implicit"), _Stepped(name, "affine")

    def begin() -> None:
        implicit.begin()
        affine.begin()

    def describe(ours: float, theirs: float) -> str:
        count = _MANY * _STEPS
        return f"{count / ours:.0f} environment steps per s, {count / theirs:.0f} affine"

    try:
        return paired_ratio(
            f"implicit plant over affine, {name}",
            implicit.step,
            affine.step,
            repetitions,
            wanted,
            describe,
            speed=True,
            prepare=begin,
        )
    finally:
        implicit.envs.close()
        affine.envs.close()


def _error() -> Row:
    scenario = make_scenario("lite_tracking", "lite", "wave")
    motion = commanded_motion(scenario.description, scenario.wiring, scenario.policy, _SECONDS)
    affine, implicit = plant_errors(motion, [("affine", None), ("implicit", None)])
    rms, most = 1e3 * implicit.hands_rms, 1e3 * implicit.hands_most
    where = f"hands, first {_SECONDS:g} s of wave"
    detail = f"mm RMS of the {where}; {most:.2f} mm at most; affine {1e3 * affine.hands_rms:.2f} mm RMS"
    return Row("implicit plant, error", rms, "mm", rms, most, 0.5, detail)


class _Stepped:
    def __init__(self, name: str, actuation: BatchActuation) -> None:
        self.envs: Any = gymnasium.make_vec(f"humanoid_sim/{name}", num_envs=_MANY, actuation=actuation)
        shape = (_STEPS, *np.shape(self.envs.action_space.sample()))
        self._actions = np.random.default_rng(0).uniform(-_SPREAD, _SPREAD, shape).astype(np.float32)

    def begin(self) -> None:
        self.envs.reset(seed=0)

    def step(self) -> None:
        for action in self._actions:
            *_, terminated, truncated, _ = self.envs.step(action)
            if terminated.any() or truncated.any():  # the next step would do less than a step
                raise AssertionError("an episode ended before the last of the steps")
