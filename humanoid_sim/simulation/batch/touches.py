"""How hard the keys of many pianos are touched, physics step by physics step."""

from __future__ import annotations

import mujoco
import numpy as np

from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.silence import mujoco_silenced
from humanoid_sim.simulation.batch.physics import BatchPhysics, ModelPool
from humanoid_sim.simulation.keys import PianoKeys

__all__ = ["BatchTouches"]

_MOVED = 1e-4
"""rad from where the spring holds a key: one that has not come so far was not touched."""


class BatchTouches:
    """Works out anew the contacts of the steps in which a key is down, which `mujoco.rollout` does not tell."""

    def __init__(self, pool: ModelPool, physics: BatchPhysics) -> None:
        """For robots with a piano.

        Raises:
            InputError: they have none.
        """
        self._pool, self._physics = pool, physics
        self._keys = PianoKeys(pool.nominal)

    def hardest(self) -> FloatArray:
        """With which force the key of each robot that was touched hardest was, in the latest control period.

        Returns:
            Shape (N,), N, normal to the surfaces; 0 where none was touched, and where a robot stood still.
        """
        found = np.zeros(len(self._physics.qpos))
        data = self._pool.room
        for i, states, controls in self._physics.latest():
            model = self._pool[i]
            angles = states[:, 1 + self._keys.qpos]
            moved = np.asarray((angles > _MOVED).any(axis=1))
            for step in np.flatnonzero(moved[:-1] | moved[1:]).tolist():
                mujoco.mj_setState(model, data, states[step], int(mujoco.mjtState.mjSTATE_FULLPHYSICS))
                data.ctrl[:] = controls[step]
                data.qacc_warmstart[:] = 0.0  # whatever was computed before: each robot gives what it would give alone
                with mujoco_silenced:
                    mujoco.mj_forward(model, data)
                found[i] = max(found[i], float(self._keys.force(model, data).max()))
        return found
