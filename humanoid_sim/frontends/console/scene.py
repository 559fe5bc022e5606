"""The robot in 3D, and second figures beside it: where its motion wants it, and where its command pulls it.

viser's scene is on a Unix socket that only this user can reach, and filled by mjviser.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import mjviser
import msgspec
import mujoco
import numpy as np
import viser
import websockets.asyncio.server

from humanoid_sim.messages import TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.figure import Figure
from humanoid_sim.rendering.ghost import ReferenceGhost, ShownReference, commanded_pose
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import JointAddresses, joint_addresses

REFERENCE, COMMAND = "reference", "command"
_COLORS: Mapping[str, tuple[int, int, int]] = MappingProxyType({REFERENCE: (64, 200, 120), COMMAND: (255, 170, 60)})


class Ghosts:
    """Figures that operators switch on and off, for all pages at once. Used from one thread."""

    def __init__(
        self, server: Any, model: mujoco.MjModel, addresses: JointAddresses, reference: ReferenceGhost | None
    ) -> None:
        """Draw nothing yet.

        Args:
            reference: the motion that the policy follows; None if it follows none that can be shown.
        """
        self._server, self._model, self._addresses, self._reference = server, model, addresses, reference
        self._shown = ShownReference()
        self.figures: dict[str, Figure] = {}
        """Those that were drawn once, by name."""
        self._is_on = {REFERENCE: reference is not None, COMMAND: False}
        self._why = dict.fromkeys(self._is_on, "")

    def switch(self, name: str, *, on: bool) -> str:
        """Switch a figure; why not, if it is refused."""
        if name not in self._is_on:
            return f"show: is '{name}', expected one of {', '.join(self._is_on)}"
        if name == REFERENCE and self._reference is None:
            return "show: the policy follows no motion that can be shown"
        self._is_on[name] = on
        return ""

    def told(self) -> dict[str, dict[str, object]]:
        """For pages: of each figure whether it is switched on, and why it is not to be seen all the same."""
        return {
            name: {"on": on, "why": self._why[name] if on else ""}
            for name, on in self._is_on.items()
            if name != REFERENCE or self._reference is not None
        }

    def look(self, record: TickRecord) -> None:
        """Take a tick, of which every one must be seen: where a motion is laid is said once."""
        self._shown.look(record)
        if self._shown.anchor is not None and self._reference is not None:
            self._reference.align(self._shown.anchor)
            self._shown.anchor = None

    def show(self, record: TickRecord, qpos: FloatArray, offset: FloatArray) -> None:
        """Draw the figures that are switched on.

        Args:
            qpos: shape (nq,), the robot's own pose.
            offset: shape (3,), m, by which the view shows everything shifted.
        """
        poses = {REFERENCE: self._wanted(qpos), COMMAND: commanded_pose(record.output.command, qpos, self._addresses)}
        self._why[COMMAND] = "" if poses[COMMAND] is not None else "no position is commanded: K_p is 0"
        for name, pose in poses.items():
            if not self._is_on[name] or pose is None:
                if name in self.figures:
                    self.figures[name].hide()
                continue
            if name not in self.figures:
                self.figures[name] = Figure(self._server, self._model, name, _COLORS[name])
            self.figures[name].show(pose, offset)

    def _wanted(self, qpos: FloatArray) -> FloatArray | None:
        """Return the reference's pose; None where there is none at present."""
        if self._reference is None or not self._is_on[REFERENCE]:
            return None
        if self._shown.frame is None:
            self._why[REFERENCE] = "the policy does not drive the robot"
            return None
        if not self._reference.has_place:
            self._why[REFERENCE] = "the console began after the motion: nobody knows where it was laid"
            return None
        self._why[REFERENCE] = ""
        return self._reference.pose(self._model, qpos, self._shown.frame)


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
