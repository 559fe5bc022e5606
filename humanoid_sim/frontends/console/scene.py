"""The robot in 3D: viser's scene, on a Unix socket that only this user can reach, filled by mjviser."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mjviser
import msgspec
import mujoco
import numpy as np
import viser
import websockets.asyncio.server

from humanoid_sim.frontends.console.ghosts import Ghosts
from humanoid_sim.messages import TickRecord
from humanoid_sim.rendering.ghost import ReferenceGhost
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import joint_addresses

FOLLOW, CONTACTS = "follow", "contacts"
"""Names, for pages, of what is switched beside the figures."""
VISER_PAGE = Path(viser.__file__).parent / "client" / "build" / "index.html"
"""viser's own page, which is one file."""
_FROM_PAGES = frozenset({"ViewerCameraMessage"})
"""Messages from pages that reach viser. Others could publish the scene through a server on the internet."""


class _Kind(msgspec.Struct):
    type: str


def may_pass(message: object) -> bool:
    """Return whether a page's message is handed on to viser."""
    try:
        return isinstance(message, bytes) and msgspec.msgpack.decode(message, type=_Kind).type in _FROM_PAGES
    except msgspec.MsgspecError:
        return False


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


class Scene:
    """The robot as it is. Used from one thread."""

    def __init__(
        self, path: Path, model: mujoco.MjModel, description: RobotDescription, reference: ReferenceGhost | None = None
    ) -> None:
        """Open viser on a Unix socket at `path`, and fill it with a model, which it may change.

        `reference` is the motion that the policy follows.
        """
        path.unlink(missing_ok=True)  # of a process that had this id before and was killed
        with _on_unix_socket(path), contextlib.redirect_stdout(io.StringIO()):
            self._server = viser.ViserServer("", 0, verbose=False)
        path.chmod(0o600)
        self._path = path
        self._model, self._data = model, mujoco.MjData(model)
        self._addresses = joint_addresses(model, description.joint_names)
        self._server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        self._server.gui.main_panel.minimize()
        is_free = model.njnt > 0 and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
        center, extent = np.array(model.stat.center), float(model.stat.extent)
        if is_free:
            center -= model.qpos0[:3]  # the scene moves with the base, which stays at its origin
        self._server.initial_camera.look_at = tuple(center)
        self._server.initial_camera.position = tuple(center + extent * np.array([1.0, 0.35, 0.25]))
        self._scene = mjviser.ViserMujocoScene(self._server, model, num_envs=1)
        self._scene.camera_tracking_enabled = self._is_free = bool(is_free)
        self.ghosts = Ghosts(self._server, model, self._addresses, reference)

    def show(self, record: TickRecord) -> None:
        """Draw the state of a tick: as simulated, or from the joints that were heard."""
        if record.qpos is not None:
            self._data.qpos[:] = record.qpos
        else:
            position = record.input.state.joint_position
            known = np.isfinite(position)
            self._data.qpos[self._addresses.qpos[known]] = position[known]
        place = mujoco.mj_fwdPosition if self._scene.show_contact_points else mujoco.mj_kinematics
        place(self._model, self._data)
        with self._server.atomic():
            self._scene.update_from_mjdata(self._data)
            self.ghosts.show(record, self._data.qpos, self._scene.fixed_bodies_frame.position)

    def told(self) -> dict[str, dict[str, object]]:
        """For pages: of each figure, and other thing to be seen, whether it is switched on, and why it is not seen."""
        own = {CONTACTS: self._scene.show_contact_points}
        if self._is_free:
            own[FOLLOW] = self._scene.camera_tracking_enabled
        return {**self.ghosts.told(), **{name: {"on": on, "why": ""} for name, on in own.items()}}

    def switch(self, name: str, *, on: bool) -> str:
        """Switch what `told` tells; why not, if it is refused."""
        if name == CONTACTS:
            self._scene.show_contact_points = on
        elif name == FOLLOW and self._is_free:
            self._follow(on=on)
        else:
            return self.ghosts.switch(name, on=on)
        return ""

    def _follow(self, *, on: bool) -> None:
        """Let the camera follow the robot, or stand; what it sees at this moment stays."""
        if on == self._scene.camera_tracking_enabled:
            return
        self._scene.camera_tracking_enabled = on
        base = self._data.xpos[int(self._model.jnt_bodyid[0])]
        offset = -base if on else base  # the scene moves with the base, or stands where the world is
        initial = self._server.initial_camera
        initial.position, initial.look_at = tuple(initial.position + offset), tuple(initial.look_at + offset)
        for client in self._server.get_clients().values():
            client.camera.position = client.camera.position + offset

    def close(self) -> None:
        """End viser and remove its socket."""
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()
        self._path.unlink(missing_ok=True)
