"""The robot in 3D, and beside it the pose that its motion asks for."""

from __future__ import annotations

import contextlib
import io

import viser

from humanoid_sim.frontends.attach import Source, shown_qpos
from humanoid_sim.messages import TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.ghost import ReferenceGhost
from humanoid_sim.rendering.robot_scene import RobotScene
from humanoid_sim.simulation.model import joint_addresses
from humanoid_sim.stack import no_policy, recorded_policy


class Scene:
    """viser's scene; for one thread."""

    def __init__(self, server: viser.ViserServer, source: Source) -> None:
        self.server = server
        self._model = source.model()
        self._addresses = joint_addresses(self._model, source.header.joint_names).qpos
        self._qpos: FloatArray = self._model.qpos0.copy()
        loaded = recorded_policy(source.header, no_policy)
        self._ghost: ReferenceGhost | None = None
        if loaded is not None:
            self._ghost = ReferenceGhost(source.description, loaded.contract, loaded.reference)
        self._scene = RobotScene(server, self._model)

    def take(self, record: TickRecord) -> None:
        """Take a tick, of which every one must be seen: the place of a motion is in one of them."""
        if self._ghost is not None:
            self._ghost.update(record)

    def show(self, record: TickRecord) -> None:
        """Draw the state of a tick: as simulated, or from the joints that are known."""
        self._qpos = shown_qpos(record, self._qpos, self._addresses)
        ghost, pose = self._ghost, None
        if ghost is not None and ghost.frame is not None:
            pose = ghost.pose(self._model, self._qpos, ghost.frame, ghost.alignment)
        with self.server.atomic():
            self._scene.show(self._qpos, pose)

    def close(self) -> None:
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()
