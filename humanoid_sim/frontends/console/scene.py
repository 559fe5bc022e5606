"""The robot in 3D, and figures beside it: where its motion wants it, and where its command pulls it."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mjviser
import mujoco
import numpy as np
import viser
import websockets.asyncio.server

from humanoid_sim.frontends.attach import Source
from humanoid_sim.messages import TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.figure import Figure
from humanoid_sim.rendering.ghost import ReferenceGhost, ShownReference, commanded_pose
from humanoid_sim.simulation.model import joint_addresses
from humanoid_sim.stack import no_policy, recorded_policy

_COLORS = {"reference": (64, 200, 120), "command": (255, 170, 60)}


class Scene:
    """viser's scene and GUI on a Unix socket of this user. The scene is used from one thread."""

    def __init__(self, path: Path, source: Source) -> None:
        with _on_unix_socket(path), contextlib.redirect_stdout(io.StringIO()):
            self.server = viser.ViserServer("", 0, verbose=False)
        self._model = source.model()
        self._data = mujoco.MjData(self._model)
        self._addresses = joint_addresses(self._model, source.description.joint_names)
        loaded = recorded_policy(source.header, no_policy)
        self._reference: ReferenceGhost | None = None
        if loaded is not None:
            self._reference = ReferenceGhost.of(source.description, loaded.contract, loaded.reference)
        self._shown = ShownReference()
        self._figures: dict[str, Figure] = {}
        is_free = self._model.njnt > 0 and self._model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
        center, extent = np.array(self._model.stat.center), float(self._model.stat.extent)
        if is_free:
            center -= self._model.qpos0[:3]  # the scene moves with the base, which stays at its origin
        camera = self.server.initial_camera
        camera.look_at = tuple(center)
        camera.position = tuple(center + extent * np.array([1.0, 0.35, 0.25]))
        self._scene = mjviser.ViserMujocoScene(self.server, self._model, num_envs=1)
        self._scene.camera_tracking_enabled = bool(is_free)

    def add_switches(self) -> None:
        """Add checkboxes to the GUI, for what is drawn beside the robot."""
        gui = self.server.gui
        self._switches: dict[str, Any] = {"command": gui.add_checkbox("Commanded pose", False)}
        if self._reference is not None:
            self._switches["reference"] = gui.add_checkbox("Motion's pose", True)
        contacts = gui.add_checkbox("Contacts", False)
        contacts.on_update(lambda _: setattr(self._scene, "show_contact_points", contacts.value))

    def take(self, record: TickRecord) -> None:
        """Take a tick, of which every one must be seen: where a motion is laid is said once."""
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
        place = mujoco.mj_fwdPosition if self._scene.show_contact_points else mujoco.mj_kinematics
        place(self._model, self._data)
        poses = {"command": commanded_pose(record.output.command, self._data.qpos, self._addresses)}
        reference, frame = self._reference, self._shown.frame
        if reference is not None and frame is not None and reference.has_place and self._switches["reference"].value:
            poses["reference"] = reference.pose(self._model, self._data.qpos, frame)
        with self.server.atomic():
            self._scene.update_from_mjdata(self._data)
            for name in self._switches:
                self._show_figure(name, poses.get(name) if self._switches[name].value else None)

    def _show_figure(self, name: str, pose: FloatArray | None) -> None:
        if pose is not None:
            if name not in self._figures:
                self._figures[name] = Figure(self.server, self._model, name, _COLORS[name])
            self._figures[name].show(pose, self._scene.fixed_bodies_frame.position)
        elif name in self._figures:
            self._figures[name].hide()

    def close(self) -> None:
        """End viser."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()


@contextlib.contextmanager
def _on_unix_socket(path: Path) -> Iterator[None]:
    """Open a Unix socket in the place of viser's TCP port, which any page of a local browser could reach."""
    serve = websockets.asyncio.server.serve

    def serve_here(handler: Any, _host: str, _port: int, **options: Any) -> Any:
        return serve(handler, unix=True, path=str(path), **options)

    websockets.asyncio.server.serve = serve_here
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve
