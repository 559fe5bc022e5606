"""A translucent figure in viser's scene: another pose of the robot, to be compared with its own."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from mjviser.conversions import is_fixed_body, merge_geoms

from humanoid_sim.mit import FloatArray

_OPACITY = 0.45
_SHOWN_GROUPS = 3  # groups of geoms that are drawn; those of the others are for collisions


class Figure:
    """A translucent copy, in one colour, of all bodies that can move."""

    def __init__(self, server: Any, model: mujoco.MjModel, name: str, color: tuple[int, int, int]) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        self.root = server.scene.add_frame(f"/ghosts/{name}", show_axes=False)
        self.bodies: dict[int, Any] = {}
        """viser's handles, by body of the model."""
        is_shown = (model.geom_group < _SHOWN_GROUPS) & (model.geom_rgba[:, 3] > 0.0)
        for body in range(1, model.nbody):
            geoms = np.flatnonzero(is_shown & (model.geom_bodyid == body)).tolist()
            if geoms and not is_fixed_body(model, body):
                mesh = merge_geoms(model, geoms)
                self.bodies[body] = server.scene.add_mesh_simple(
                    f"/ghosts/{name}/{body}",
                    np.asarray(mesh.vertices, np.float32),
                    np.asarray(mesh.faces, np.uint32),
                    color=color,
                    opacity=_OPACITY,
                    cast_shadow=False,
                    receive_shadow=False,
                )

    def show(self, qpos: FloatArray, offset: FloatArray) -> None:
        """Draw it at `qpos`, shape (nq,), shifted by `offset`, shape (3,), m."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        self.root.position, self.root.visible = offset, True
        for body, handle in self.bodies.items():
            handle.position, handle.wxyz = self._data.xpos[body].copy(), self._data.xquat[body].copy()

    def hide(self) -> None:
        """Do not draw it."""
        self.root.visible = False
