"""A robot in viser's scene, and beside it, translucent, the pose that a motion asks for."""

from __future__ import annotations

from typing import Any

import mjviser
import mujoco
import numpy as np
from mjviser.conversions import is_fixed_body, merge_geoms

from humanoid_sim.mit import FloatArray

_GREEN, _OPACITY = (64, 200, 120), 0.45
_SHOWN_GROUPS = 3  # groups of geoms that are drawn; those of the others are for collisions


class RobotScene:
    """Draws poses of one model; a base that moves freely stays in place, and the world moves under it."""

    def __init__(self, server: Any, model: mujoco.MjModel) -> None:
        self._scene, self._model = server.scene, model
        self._data = mujoco.MjData(model)
        self._ghost: Any = None
        self._ghost_bodies: dict[int, Any] = {}
        self._view = mjviser.ViserMujocoScene(server, model, num_envs=1)
        is_free = model.njnt > 0 and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
        self._view.camera_tracking_enabled = bool(is_free)
        center = model.stat.center - (model.qpos0[:3] if is_free else 0.0)
        server.initial_camera.look_at = tuple(center)
        server.initial_camera.position = tuple(center + model.stat.extent * np.array([1.0, 0.35, 0.25]))

    def show(self, qpos: FloatArray, ghost: FloatArray | None = None) -> None:
        """Draw the robot at `qpos`, and the motion's pose at `ghost`, both shape (nq,); None for none."""
        self._view.update_from_mjdata(self._posed(qpos))
        if ghost is not None:
            if self._ghost is None:
                self._add_ghost()
            data = self._posed(ghost)
            self._ghost.position, self._ghost.visible = self._view.fixed_bodies_frame.position, True
            for body, handle in self._ghost_bodies.items():
                handle.position, handle.wxyz = data.xpos[body].copy(), data.xquat[body].copy()
        elif self._ghost is not None:
            self._ghost.visible = False

    def _posed(self, qpos: FloatArray) -> mujoco.MjData:
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        return self._data

    def _add_ghost(self) -> None:
        """Add a copy, in one colour, of all bodies that can move."""
        model, scene = self._model, self._scene
        self._ghost = scene.add_frame("/ghost", show_axes=False)
        is_shown = (model.geom_group < _SHOWN_GROUPS) & (model.geom_rgba[:, 3] > 0.0)
        for body in range(1, model.nbody):
            geoms = np.flatnonzero(is_shown & (model.geom_bodyid == body)).tolist()
            if geoms and not is_fixed_body(model, body):
                mesh = merge_geoms(model, geoms)
                shape = np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.uint32)
                handle = scene.add_mesh_simple(f"/ghost/{body}", *shape, color=_GREEN, opacity=_OPACITY)
                self._ghost_bodies[body] = handle
