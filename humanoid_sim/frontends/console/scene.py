"""The robot in 3D, and beside it a figure where its motion wants it."""

from __future__ import annotations

import contextlib
import io

import mjviser
import mujoco
import numpy as np
import viser

from humanoid_sim.frontends.attach import Source
from humanoid_sim.messages import TickRecord
from humanoid_sim.rendering.figure import Figure
from humanoid_sim.rendering.ghost import ReferenceGhost, ShownReference
from humanoid_sim.simulation.model import joint_addresses
from humanoid_sim.stack import no_policy, recorded_policy

_GHOST = (64, 200, 120)


class Scene:
    """viser's scene; for one thread."""

    def __init__(self, server: viser.ViserServer, source: Source) -> None:
        self.server = server
        self._model = source.model()
        self._data = mujoco.MjData(self._model)
        self._addresses = joint_addresses(self._model, source.description.joint_names)
        loaded = recorded_policy(source.header, no_policy)
        self._reference: ReferenceGhost | None = None
        if loaded is not None:
            self._reference = ReferenceGhost.of(source.description, loaded.contract, loaded.reference)
        self._shown = ShownReference()
        self._figure = None if self._reference is None else Figure(server, self._model, "reference", _GHOST)
        is_free = self._model.njnt > 0 and self._model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
        center, extent = np.array(self._model.stat.center), float(self._model.stat.extent)
        if is_free:
            center -= self._model.qpos0[:3]  # the scene moves with the base, which stays at its origin
        camera = server.initial_camera
        camera.look_at = tuple(center)
        camera.position = tuple(center + extent * np.array([1.0, 0.35, 0.25]))
        self._scene = mjviser.ViserMujocoScene(server, self._model, num_envs=1)
        self._scene.camera_tracking_enabled = bool(is_free)

    def take(self, record: TickRecord) -> None:
        """Take a tick, of which every one must be seen: the place of a motion is in one of them."""
        self._shown.look(record)
        if self._shown.anchor is not None and self._reference is not None:
            self._reference.align(self._shown.anchor)
            self._shown.anchor = None

    def show(self, record: TickRecord) -> None:
        """Draw the state of a tick: as simulated, or from the joints that are known."""
        if record.qpos is not None:
            self._data.qpos[:] = record.qpos
        else:
            position = record.input.state.joint_position
            known = np.isfinite(position)
            self._data.qpos[self._addresses.qpos[known]] = position[known]
        mujoco.mj_kinematics(self._model, self._data)
        with self.server.atomic():
            self._scene.update_from_mjdata(self._data)
            if self._figure is not None and self._reference is not None:
                if self._shown.frame is None or not self._reference.has_place:
                    self._figure.hide()
                else:
                    pose = self._reference.pose(self._model, self._data.qpos, self._shown.frame)
                    self._figure.show(pose, self._scene.fixed_bodies_frame.position)

    def close(self) -> None:
        """End viser, which says so."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()
