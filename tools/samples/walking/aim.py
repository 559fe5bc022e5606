"""Commands for the trained network with which the robot goes as fast as it is asked to.

Training ends with a network that follows a command in proportion, but not exactly; sideways steps turn it. That is
measured, and the inverse goes into the exported graph before network and gait. What they are told stays within
the commands that they were trained with: what is asked beyond that is gone for as fast as they can.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from humanoid_sim.envs.scenario import Scenario
from humanoid_sim.evaluation.rollout import ClosedLoop
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.onnx_policy import onnx_runtime
from humanoid_sim.simulation.batch import BatchSimulation

__all__ = ["NO_AIM", "Aim", "aim_from", "measure_response"]

_ASKED = np.array(
    [
        *((x, 0.0, 0.0) for x in (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, -0.2, -0.3, -0.4)),
        *((0.0, y, 0.0) for y in (0.1, 0.2, -0.1, -0.2)),
        *((0.0, 0.0, w) for w in (0.25, 0.5, -0.25, -0.5)),
    ]
)
"""m/s, m/s, rad/s."""
_SETTLE, _MEASURED = 96, 192
"""Policy steps: three gait cycles, then six."""
_MOST = 2.0
"""Largest value of a gain, and of what turning and stepping aside add to each other."""


_FAST = 0.6
"""m/s, told: faster than that, an ankle is at its limit in every step."""
SPEEDS = np.array([0.15, 0.3, 0.45, 0.6, 0.8])
"""m/s, forward. Nothing faster is aimed at."""


@dataclass(frozen=True, slots=True, eq=False)
class Aim:
    """Command for the network, from the one that was asked for."""

    ahead: FloatArray
    """Shape (5,), m/s, what is told for the forward commands `SPEEDS`; in proportion between 0 and these."""
    back: float
    """Factor on a backward command."""
    aside: FloatArray
    """Shape (2, 2), on sideways command and yaw rate together."""
    most: FloatArray
    """Shape (3, 2), the least and the greatest that are told: the ranges of training."""

    def told(self, command: FloatArray) -> FloatArray:
        """Commands (..., 3) as the network is told."""
        asked = command[..., :1]
        ahead = np.interp(asked, [0.0, *SPEEDS], [0.0, *self.ahead])
        forward = ahead + self.back * np.minimum(asked, 0.0)
        aside = command[..., 1:] @ self.aside.T
        told: FloatArray = np.clip(np.concatenate([forward, aside], axis=-1), self.most[:, 0], self.most[:, 1])
        return told


_EVERYTHING = np.array([[-1e3, 1e3]] * 3)
NO_AIM = Aim(SPEEDS, 1.0, np.eye(2), _EVERYTHING)
"""Tells what is asked."""


def measure_response(scenario: Scenario, policy: Path) -> FloatArray:
    """Return what the robot does, shape (k, 3), for each of the commands that `aim_from` knows; m/s, m/s, rad/s."""
    session = onnx_runtime().InferenceSession(str(policy), providers=["CPUExecutionProvider"])
    source, count = session.get_inputs()[0].name, len(_ASKED)
    simulation = BatchSimulation(
        scenario.description,
        count,
        control_period=scenario.contract.policy_dt,
        physics_timestep=scenario.physics_timestep,
        actuation="implicit" if scenario.actuation == "implicit" else "affine",
    )
    with closing(simulation):
        loop, done = ClosedLoop(simulation, scenario.wiring, _ASKED), []
        for step in range(_SETTLE + _MEASURED):
            (action,) = session.run(None, {source: loop.observation})
            loop.act(np.asarray(action))
            base = simulation.base
            assert base is not None
            if step >= _SETTLE:
                done.append(base.planar_velocity)
    response: FloatArray = np.mean(done, axis=0)
    return response


def aim_from(response: FloatArray, ranges: FloatArray) -> Aim:
    """Return the inverse of a response, as `measure_response` gives it; `ranges` (3, 2) are those of training."""
    back = _gain(response, _ASKED[:, 0] < 0.0)
    turned = _ASKED[:, 0] == 0.0
    slope, *_ = np.linalg.lstsq(_ASKED[turned, 1:], response[turned, 1:], rcond=None)
    aside = np.clip(np.linalg.inv(slope.T), -_MOST, _MOST)
    return Aim(_forward(response), back, aside, np.array(ranges))


def _forward(response: FloatArray) -> FloatArray:
    """Return what is to be told for `SPEEDS`, shape (5,)."""
    rows = _ASKED[:, 0] > 0.0
    done = np.maximum.accumulate([0.0, *response[rows, 0]])
    told = np.interp(SPEEDS, done, [0.0, *_ASKED[rows, 0]])
    most = np.minimum(SPEEDS * _MOST, np.maximum(SPEEDS, _FAST))
    told_at: FloatArray = np.clip(told, SPEEDS / _MOST, most)
    return told_at


def _gain(response: FloatArray, rows: npt.NDArray[np.bool_]) -> float:
    asked, done = _ASKED[rows, 0], response[rows, 0]
    return float(np.clip((asked @ asked) / max(float(asked @ done), 1e-6), 1.0 / _MOST, _MOST))
