"""Second figures beside the robot in the 3D view: where its motion wants it, and where its command pulls it."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import mujoco
import numpy as np
from mjviser.conversions import is_fixed_body, merge_geoms

from humanoid_sim.messages import TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.ghost import ReferenceGhost, ShownReference, commanded_pose
from humanoid_sim.simulation.model import JointAddresses

REFERENCE, COMMAND = "reference", "command"
_COLORS: Mapping[str, tuple[int, int, int]] = MappingProxyType({REFERENCE: (64, 200, 120), COMMAND: (255, 170, 60)})
_OPACITY = 0.45
_SHOWN_GROUPS = 3
"""Groups of geoms that are drawn; those of the others are for collisions."""


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

    def follow(self, reference: ReferenceGhost | None) -> None:
        """Show the motion of a policy that was loaded; argument as for the constructor."""
        self._reference, self._shown = reference, ShownReference()
        self._is_on[REFERENCE] = reference is not None

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
                self.figures[name] = Figure(self._server, self._model, name)
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


class Figure:
    """A translucent copy of all bodies that can move."""

    def __init__(self, server: Any, model: mujoco.MjModel, name: str) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        self.root = server.scene.add_frame(f"/ghosts/{name}", show_axes=False)
        self.bodies: dict[int, Any] = {}
        """viser's handles, by body of the model."""
        for body in range(1, model.nbody):
            first = model.body_geomadr[body]
            geoms = [
                geom
                for geom in range(first, first + model.body_geomnum[body])
                if model.geom_group[geom] < _SHOWN_GROUPS and model.geom_rgba[geom, 3] > 0.0
            ]
            if not geoms or is_fixed_body(model, body):
                continue
            mesh = merge_geoms(model, geoms)
            handle = server.scene.add_mesh_simple(
                f"/ghosts/{name}/{body}",
                np.asarray(mesh.vertices, np.float32),
                np.asarray(mesh.faces, np.uint32),
                color=_COLORS[name],
                opacity=_OPACITY,
                cast_shadow=False,
                receive_shadow=False,
            )
            self.bodies[body] = handle

    def show(self, qpos: FloatArray, offset: FloatArray) -> None:
        """Draw it at `qpos`, shape (nq,), shifted by `offset`, shape (3,), m."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        self.root.position = offset
        self.root.visible = True
        for body, handle in self.bodies.items():
            handle.position, handle.wxyz = self._data.xpos[body].copy(), self._data.xquat[body].copy()

    def hide(self) -> None:
        """Do not draw it."""
        self.root.visible = False
