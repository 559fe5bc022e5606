"""Poses of a run, 25 a second, kept in memory: a page or a video is made of them when the run is over."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import mujoco

from humanoid_sim.messages import Event, EventKind, TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.caption import Caption
from humanoid_sim.rendering.ghost import ReferenceGhost, ShownReference
from humanoid_sim.session.sinks import Sink

RATE = 25.0  # Hz
_LONGEST_PAUSE = 1.0  # s, to which a longer jump of the robot's clock is shortened


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """One pose of a run."""

    time: float  # s since the first one, pauses shortened
    qpos: FloatArray  # shape (nq,)
    caption: Caption
    frame: int | None = None  # index of the motion's frame, while the policy drives the robot
    anchor: FloatArray | None = None  # pose (7,), m and w x y z, of the anchor body when frame 0 was shown


class Moments(Sink):
    """Collects poses of a simulated robot; of a long run fewer a second, so that it is kept whole.

    Args:
        ghost: the motion that the policy follows; None for none.
        most: poses beyond which every second one is dropped.
    """

    def __init__(self, ghost: ReferenceGhost | None = None, *, most: int = 5000) -> None:
        self.ghost, self._most = ghost, most
        self.rate = RATE
        """Poses per second."""
        self.kept: list[Moment] = []
        self.fell: float | None = None
        """s, robot's clock, at which the robot fell."""
        self._shown = ShownReference()
        self._clock, self._last_time, self._due = 0.0, math.nan, 0.0

    def tick(self, record: TickRecord) -> None:
        """Keep the pose, if one is due."""
        if record.qpos is None:
            return
        time = float(record.input.state.time)
        self._clock += min(max(0.0, time - self._last_time), _LONGEST_PAUSE)  # NaN, and backwards: 0
        self._last_time = time
        self._shown.look(record)
        if self._clock < self._due:
            return
        self.kept.append(Moment(self._clock, record.qpos, Caption.of(record), self._shown.frame, self._shown.anchor))
        if len(self.kept) >= self._most:
            self.kept, self.rate = self.kept[::2], self.rate / 2.0
        self._due = (math.floor(self._clock * self.rate + 1e-6) + 1) / self.rate - 1e-6

    def event(self, event: Event) -> None:
        """Note a fall."""
        if event.kind is EventKind.FALL and self.fell is None:
            self.fell = event.time

    def ghosts(self, model: mujoco.MjModel) -> Iterator[FloatArray | None]:
        """Yield for each pose the motion's, shape (nq,); None where the policy follows none."""
        for moment in self.kept:
            ghost, pose = self.ghost, None
            if ghost is not None and moment.frame is not None:
                if moment.anchor is not None:
                    ghost.align(moment.anchor)
                pose = ghost.pose(model, moment.qpos, moment.frame) if ghost.has_place else None
            yield pose
