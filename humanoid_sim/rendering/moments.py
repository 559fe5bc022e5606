"""Poses of a run, 25 a second, kept in memory: a page or a video is made of them when the run is over."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
from rich.console import Console
from rich.progress import Progress

from humanoid_sim.messages import Event, EventKind, TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.caption import Caption
from humanoid_sim.rendering.ghost import ReferenceGhost, ShownReference
from humanoid_sim.session.sinks import Sink

RATE = 25.0
"""Hz"""
_LONGEST_PAUSE = 1.0
"""s. A longer jump of the robot's clock is shortened to this."""


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """One pose of a run."""

    time: float
    """s since the first one, pauses shortened."""
    qpos: FloatArray
    """Shape (nq,)."""
    caption: Caption
    frame: int | None = None
    """Index of the motion's frame, while the policy drives the robot."""
    anchor: FloatArray | None = None
    """Pose (7,), m and w x y z, of the anchor body when the policy was shown frame 0; None where there is none."""


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
        time = record.input.state.time
        if record.qpos is None or not isinstance(time, float):
            return
        self._clock += min(max(0.0, time - self._last_time), _LONGEST_PAUSE)  # NaN, and backwards: 0
        self._last_time = time
        self._shown.look(record)
        if self._clock < self._due:
            return
        shown, caption = self._shown, Caption.of(record)
        self.kept.append(Moment(self._clock, record.qpos, caption, shown.frame, shown.anchor))
        if len(self.kept) >= self._most:
            self.kept, self.rate = self.kept[::2], self.rate / 2.0
        self._due = (math.floor(self._clock * self.rate + 1e-6) + 1) / self.rate - 1e-6

    def event(self, event: Event) -> None:
        """Note a fall."""
        if event.kind is EventKind.FALL and self.fell is None:
            self.fell = event.time

    def ghosts(self, model: mujoco.MjModel) -> Iterator[FloatArray | None]:
        """Yield for each pose the motion's, shape (nq,); None where the policy follows none."""
        anchor: FloatArray | None = None
        for moment in self.kept:
            ghost = self.ghost
            if ghost is None or moment.frame is None:
                yield None
                continue
            if moment.anchor is not None and moment.anchor is not anchor:
                anchor = moment.anchor
                ghost.align(anchor)
            yield ghost.pose(model, moment.qpos, moment.frame) if ghost.has_place else None


@contextmanager
def pose_progress(console: Console, label: str) -> Iterator[Callable[[int, int], None]]:
    """Show a bar on a terminal while poses are drawn; yields what takes their number so far and their total."""
    if not console.is_terminal:  # where rich would print an empty line
        yield lambda done, total: None  # noqa: ARG005
        return
    with Progress(console=console, transient=True) as bar:
        task = bar.add_task(label, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
