"""Poses of whole levels of a tree of bodies at once: left and right limbs in the same few array operations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray
from humanoid_sim.simulation.batch.body_links import BALL, FREE, SLIDE, Body, BodyPose, place
from humanoid_sim.simulation.batch.rows import multiply, rotate

__all__ = ["BodyLevels"]

IndexArray = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class _Hinges:
    """Bodies of one level, each with one hinge through its origin, or with none: a hinge that never turns."""

    slots: IndexArray
    parents: IndexArray
    position: FloatArray
    """Shape (3, k, 1), m, parent frame."""
    unturned: FloatArray
    """Shape (4, k, 1), the body's quaternion in the parent frame where the hinge is at its zero."""
    turning: FloatArray
    """Shape (4, k, 1): turned by 2 h, the body's quaternion is `cos h · unturned + sin h · turning`."""
    hinges: IndexArray
    """Shape (k,), rows of the half angles; the last row is that of welded bodies, 0."""


@dataclass(frozen=True, slots=True, eq=False)
class _Single:
    """A body with any other joints."""

    slot: int
    parent: int
    body: Body


class BodyLevels:
    """The moving bodies of a tree, in the order in which their poses follow from one another."""

    def __init__(self, bodies: Mapping[int, Body], still: Mapping[int, BodyPose]) -> None:
        """Sort the bodies.

        Args:
            bodies: by id, parents before their children.
            still: poses of the bodies that do not move, by id.
        """
        roots = sorted({body.parent for body in bodies.values()} - set(bodies))
        self._slots = {i: slot for slot, i in enumerate([*roots, *bodies])}
        self._moving = tuple(bodies)
        self._root_positions = np.array([still[i].position for i in roots]).reshape(-1, 3).T[:, :, None]
        self._root_quaternions = np.array([still[i].quaternion for i in roots]).reshape(-1, 4).T[:, :, None]
        simple = {i: body for i, body in bodies.items() if _is_simple(body)}
        turning = [i for i, body in simple.items() if body.joints]
        self._qpos = np.array([simple[i].joints[0].qpos for i in turning], dtype=np.intp)
        self._zero = np.array([simple[i].joints[0].zero for i in turning]).reshape(-1, 1)
        row = {i: k for k, i in enumerate(turning)}
        depth: dict[int, int] = {}
        for i, body in bodies.items():
            depth[i] = depth.get(body.parent, 0) + 1
        self._levels: list[_Hinges | _Single] = []
        for level in range(1, max(depth.values(), default=0) + 1):
            here = [i for i in bodies if depth[i] == level]
            self._levels += [
                _Single(self._slots[i], self._slots[bodies[i].parent], bodies[i]) for i in here if i not in simple
            ]
            together = [i for i in here if i in simple]
            if together:
                self._levels.append(
                    self._hinges({i: simple[i] for i in together}, [row.get(i, len(row)) for i in together])
                )

    def _hinges(self, bodies: Mapping[int, Body], hinges: list[int]) -> _Hinges:
        unturned = np.stack([body.quaternion for body in bodies.values()], axis=1)
        axes = np.zeros_like(unturned)
        for k, body in enumerate(bodies.values()):
            if body.joints:
                axes[1:, k] = body.joints[0].axis
        return _Hinges(
            slots=np.array([self._slots[i] for i in bodies], dtype=np.intp),
            parents=np.array([self._slots[body.parent] for body in bodies.values()], dtype=np.intp),
            position=np.stack([body.position for body in bodies.values()], axis=1),
            unturned=unturned,
            turning=multiply(unturned, axes),
            hinges=np.array(hinges, dtype=np.intp),
        )

    def poses(self, qpos: FloatArray) -> dict[int, BodyPose]:
        """Poses of the moving bodies by id; `qpos` is (nq, N)."""
        count = qpos.shape[1]
        position = np.empty((3, len(self._slots), count))
        quaternion = np.empty((4, len(self._slots), count))
        roots = self._root_positions.shape[1]
        position[:, :roots], quaternion[:, :roots] = self._root_positions, self._root_quaternions
        half = np.zeros((len(self._qpos) + 1, count))
        half[:-1] = 0.5 * (qpos[self._qpos] - self._zero)
        cos, sin = np.cos(half), np.sin(half)
        for level in self._levels:
            if isinstance(level, _Single):
                parent = BodyPose(position[:, level.parent], quaternion[:, level.parent])
                pose = place(level.body, parent, qpos)
                position[:, level.slot], quaternion[:, level.slot] = pose.position, pose.quaternion
                continue
            turn = level.unturned * cos[level.hinges] + level.turning * sin[level.hinges]
            parents = quaternion[:, level.parents]
            position[:, level.slots] = position[:, level.parents] + rotate(parents, level.position)
            quaternion[:, level.slots] = multiply(parents, turn)
        return {i: BodyPose(position[:, self._slots[i]], quaternion[:, self._slots[i]]) for i in self._moving}


def _is_simple(body: Body) -> bool:
    if not body.joints:
        return True
    return len(body.joints) == 1 and body.joints[0].is_centred and body.joints[0].kind not in (FREE, BALL, SLIDE)
