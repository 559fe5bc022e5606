"""Where bodies are in every environment of a batch: MuJoCo's forward kinematics as array arithmetic."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.mit import FloatArray
from humanoid_sim.simulation.batch.body_levels import BodyLevels
from humanoid_sim.simulation.batch.body_links import BodyPose, read_body
from humanoid_sim.simulation.batch.body_motion import BodyMotion, move, rest
from humanoid_sim.simulation.batch.rows import column

__all__ = ["BodyTree", "body_ids"]


def body_ids(model: mujoco.MjModel, names: Sequence[str]) -> tuple[int, ...]:
    """Ids of bodies by name.

    Raises:
        InputError: a name is not a body of the model; the message lists those that are.
    """
    known = [model.body(i).name for i in range(1, model.nbody)]
    for name in names:
        if name not in known:
            raise InputError(known_names("body", name, known))
    return tuple(int(model.body(name).id) for name in names)


class BodyTree:
    """The chains of bodies that lead to the ones asked for.

    The arithmetic is that of `mj_kinematics`, so the signs of the quaternions are its signs too. Only what does not
    move is taken from the model once; masses may differ between environments, lengths may not.
    """

    def __init__(self, model: mujoco.MjModel, bodies: Sequence[int]) -> None:
        """Find the chains.

        Args:
            model: any one of the batch.
            bodies: ids of the bodies whose poses will be asked for.
        """
        self.bodies = tuple(int(body) for body in bodies)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        # What is welded to the world, the world itself included, is where it is.
        self._still = {
            int(i): BodyPose(column(data.xpos[i]), column(data.xquat[i]))
            for i in np.flatnonzero(np.asarray(model.body_weldid) == 0)
        }
        needed: set[int] = set()
        for body in self.bodies:
            link = body
            while link not in self._still and link not in needed:
                needed.add(link)
                link = int(model.body_parentid[link])
        self._moving = {i: read_body(model, i) for i in sorted(needed)}  # parents have the lower ids
        self._levels = BodyLevels(self._moving, self._still)

    def poses(self, qpos: FloatArray) -> dict[int, BodyPose]:
        """Pose of every body on the chains, by id.

        Args:
            qpos: shape (N, nq), MuJoCo's generalised position.
        """
        return self._still | self._levels.poses(np.ascontiguousarray(qpos.T))

    def arrays(self, qpos: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions (N, b, 3), m, and quaternions (N, b, 4), w x y z, of the bodies asked for, world frame."""
        poses = self.poses(qpos)
        position = np.empty((len(qpos), len(self.bodies), 3))
        quaternion = np.empty((len(qpos), len(self.bodies), 4))
        for b, body in enumerate(self.bodies):
            position[:, b] = poses[body].position.T
            quaternion[:, b] = poses[body].quaternion.T
        return position, quaternion

    def motion(self, body: int, qpos: FloatArray, qvel: FloatArray, qacc: FloatArray) -> BodyMotion:
        """Pose, velocity and acceleration of one body on the chains.

        Args:
            body: its id.
            qpos: shape (N, nq).
            qvel: shape (N, nv).
            qacc: shape (N, nv).
        """
        if body in self._still:
            return rest(self._still[body])
        own = self._moving[body]
        return move(own, self.motion(own.parent, qpos, qvel, qacc), qpos.T, qvel.T, qacc.T)
