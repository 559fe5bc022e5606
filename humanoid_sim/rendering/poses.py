"""Poses of a run, 25 a second, kept in memory: a page or a video is made of them when the run is over."""

from __future__ import annotations

import math
from typing import NamedTuple

from humanoid_sim.controllers.reference import Alignment
from humanoid_sim.messages import Mode, TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.recording.sink import Sink
from humanoid_sim.rendering.ghost import ReferenceGhost

_MOST = 5000  # poses, beyond which every second one is dropped


class Pose(NamedTuple):
    """One pose of a run."""

    time: float  # s since the first one
    qpos: FloatArray  # shape (nq,)
    mode: Mode
    frame: int | None  # of the motion, while the policy drives the robot
    alignment: Alignment | None  # of the motion with the robot


class Poses(Sink):
    """Collects poses of a simulated robot, and where the ghost of its motion is; of a long run fewer a second."""

    def __init__(self, ghost: ReferenceGhost | None = None) -> None:
        self.ghost = ghost
        self.rate = 25.0  # Hz, at which poses are kept
        self.kept: list[Pose] = []
        self._start, self._due = math.nan, 0.0

    def tick(self, record: TickRecord) -> None:
        """Keep the pose, if one is due."""
        if record.qpos is None:
            return
        frame = alignment = None
        if self.ghost is not None:
            self.ghost.update(record)
            frame, alignment = self.ghost.frame, self.ghost.alignment
        if not self.kept:
            self._start = float(record.input.state.time)
        time = float(record.input.state.time) - self._start
        if time < self._due:
            return
        self.kept.append(Pose(time, record.qpos, record.output.control_mode.mode, frame, alignment))
        if len(self.kept) >= _MOST:
            self.kept, self.rate = self.kept[::2], self.rate / 2.0
        self._due = (math.floor(time * self.rate + 1e-6) + 1) / self.rate - 1e-6
