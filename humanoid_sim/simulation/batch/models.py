"""The models of a batch: one for all environments as long as they agree, else one each, copied once."""

from __future__ import annotations

import copy

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray

__all__ = ["ModelPool"]


class ModelPool:
    """N models of the same robot; the gains of its affine actuators live in them."""

    def __init__(self, nominal: mujoco.MjModel, count: int) -> None:
        """Share one copy of the model between `count` environments."""
        self.nominal = nominal
        self.is_shared = True
        shared = copy.copy(nominal)
        # An array of references picks any subset without a Python loop.
        self._models = np.empty(count, dtype=object)
        self._models[:] = shared
        self._list: list[mujoco.MjModel] = [shared] * count

    def __getitem__(self, i: int) -> mujoco.MjModel:
        """The model of environment i."""
        return self._models[i]

    def select(self, indices: npt.NDArray[np.intp] | None) -> list[mujoco.MjModel]:
        """The models of these environments, None for all."""
        return self._list if indices is None else self._models[indices].tolist()

    def separate(self) -> None:
        """Give each environment a model of its own, equal to the shared one."""
        if self.is_shared:
            self.is_shared = False
            self._list = [copy.copy(self._list[0]) for _ in self._list]
            self._models[:] = self._list

    def set_gains(self, changed: npt.NDArray[np.intp], bias: FloatArray) -> None:
        """Put gains into the actuators.

        Args:
            changed: shape (k,), environments whose gains are not yet in their models.
            bias: shape (N, n, 2), of all environments, see `affine_law`.
        """
        if self.is_shared:
            if (bias == bias[0]).all():
                changed = np.zeros(1, dtype=np.intp)
            else:
                self.separate()
                changed = np.arange(len(bias))
        for i in changed:
            self._models[i].actuator_biasprm[:, 1:3] = bias[i]
