"""A simulated piano's keys: which are pressed, and how hard."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from humanoid_sim.errors import InputError, blaming
from humanoid_sim.mit import FloatArray, IndexArray
from humanoid_sim.robots.piano import TRIGGER, key_joint_names
from humanoid_sim.simulation.model import joint_addresses


@dataclass(frozen=True, slots=True)
class Touch:
    """A key that is touched."""

    force: float
    """N, normal to the surfaces."""
    key: int
    """0 is A0, 87 is C8."""
    time: float
    """s"""


class PianoKeys:
    """The 88 keys of a model, the lowest first. Keeps nothing of a simulation: any thread may ask."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Find the keys. Raises `InputError` without a piano."""
        with blaming("piano", InputError):
            addresses = joint_addresses(model, key_joint_names())
        self.qpos: IndexArray = addresses.qpos
        """Shape (88,), indices into MuJoCo's generalised position."""
        ids = [model.joint(name).id for name in key_joint_names()]
        self.upper: FloatArray = model.jnt_range[ids, 1].copy()
        """Shape (88,), rad: their whole travel."""
        self._trigger = TRIGGER * self.upper
        self._key_of_geom = np.full(model.ngeom, -1)
        for i, body in enumerate(model.jnt_bodyid[ids].tolist()):
            self._key_of_geom[model.geom_bodyid == body] = i

    def pressed(self, qpos: FloatArray) -> FloatArray:
        """Return which keys sound, shape (..., 88): 1 where one is beyond 0.70 of its travel, strictly, else 0.

        `qpos`, shape (..., nq), is MuJoCo's generalised position.
        """
        pressed: FloatArray = (qpos[..., self.qpos] > self._trigger).astype(np.float64)
        return pressed

    def force(self, model: mujoco.MjModel, data: mujoco.MjData) -> FloatArray:
        """Shape (88,), N, normal to the surfaces, with which each key is touched in the step that `data` has taken."""
        force = np.zeros(len(self.qpos))
        if data.ncon:
            touched = self._key_of_geom[data.contact.geom].max(axis=1)
            wrench = np.empty(6)
            for contact in np.flatnonzero(touched >= 0).tolist():
                mujoco.mj_contactForce(model, data, contact, wrench)
                force[touched[contact]] += wrench[0]
        return force


def hardest_touch(
    keys: PianoKeys, model: mujoco.MjModel, data: mujoco.MjData, time: float, before: Touch | None
) -> Touch | None:
    """Return the hardest touch of the latest physics step, or the one before if that was as hard; None for none."""
    if not data.ncon:
        return before
    force = keys.force(model, data)
    key = int(force.argmax())
    least = 0.0 if before is None else before.force
    return Touch(float(force[key]), key, time) if force[key] > least else before
