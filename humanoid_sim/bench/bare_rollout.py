"""The physics of a batch of robots alone, to compare with."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco import rollout

from humanoid_sim.envs.batch import BatchSimulation
from humanoid_sim.mit import FloatArray

__all__ = ["BareRollout"]


class BareRollout:
    """The same models, states, controls and threads as a batch simulation's, and nothing around them."""

    def __init__(
        self, simulation: BatchSimulation, qpos: FloatArray, qvel: FloatArray, targets: Sequence[FloatArray]
    ) -> None:
        """Work out the controls.

        Args:
            simulation: that has taken a command already, so that the gains are in its models.
            qpos: shape (N, nq), where it starts.
            qvel: shape (N, nv).
            targets: shape (N, n) each, rad, the positions that are commanded one control period after the other.
        """
        self.models = [simulation.model(i) for i in range(simulation.count)]
        model = self.models[0]
        stiffness = np.array([-each.actuator_biasprm[:, 1] for each in self.models])
        steps = simulation.physics_steps
        self._controls = [np.repeat((stiffness * target)[:, None], steps, axis=1) for target in targets]
        self._initial = np.zeros((simulation.count, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
        self._initial[:, 1:] = np.concatenate([qpos, qvel], axis=1)
        self._path = np.zeros((simulation.count, steps, self._initial.shape[1]))
        self._data = [mujoco.MjData(model) for _ in range(simulation.threads)]
        self._rollout = rollout.Rollout(nthread=simulation.threads if simulation.threads > 1 else 0)

    @property
    def qpos(self) -> FloatArray:
        """Shape (N, nq), after the latest physics step."""
        return self._path[:, -1, 1 : 1 + self.models[0].nq]

    def run(self) -> None:
        """From the start through all control periods, one call each, as whoever answers to the state needs it."""
        state, velocity = self._initial, slice(1 + self.models[0].nq, None)
        acceleration = np.zeros_like(state[:, velocity])
        for control in self._controls:
            self._rollout.rollout(
                self.models,
                self._data,
                state,
                control,
                nstep=control.shape[1],
                skip_checks=True,
                initial_warmstart=acceleration,
                state=self._path,
            )
            state = self._path[:, -1].copy()
            acceleration = (state - self._path[:, -2])[:, velocity] / self.models[0].opt.timestep

    def close(self) -> None:
        """Stop the threads."""
        self._rollout.close()
