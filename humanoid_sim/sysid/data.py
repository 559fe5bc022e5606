"""Measured runs for identification: what every joint was told, and where it then was, each at its own time."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import InputError
from humanoid_sim.messages import TickRecord
from humanoid_sim.mit import COMMAND_FIELDS, FloatArray
from humanoid_sim.recording.reader import open_recording

BoolArray = npt.NDArray[np.bool_]

STALE = 0.1
"""s: a joint whose state is older is not heard, and ends a stretch of data."""
_GAP = 2.5
"""Usual distances between two ticks from which the run is taken to be interrupted."""
_WINDOW, _SHORTEST = 10.0, 2.0
"""s that are predicted at a time from a measured state; the least that is worth it."""
SETTLING = 0.5
"""s at the beginning of a window that are not compared: there the error of the measured state still acts."""


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """One run in columns, joints in the robot's order, angles in the joint frame."""

    source: str
    time: FloatArray
    """Shape (t,), s: when each command left."""
    position: FloatArray
    """Shape (t, n), rad, as reported, like the next two: NaN where the source has none."""
    velocity: FloatArray
    """Shape (t, n), rad/s."""
    effort: FloatArray
    """Shape (t, n), N·m."""
    age: FloatArray
    """Shape (t, n), s by which the report is older than `time`."""
    command: FloatArray
    """Shape (t, 5, n), the five fields in their frozen order."""
    quaternion: FloatArray
    """Shape (t, 4), w x y z, IMU in the world."""

    @property
    def digest(self) -> str:
        """Return what is the same for two runs with the same data, whenever they began."""
        parts = (self.time - self.time[:1], self.position, self.velocity, self.command)
        return hashlib.sha256(b"".join(np.round(part, 9).tobytes() for part in parts)).hexdigest()


@dataclass(frozen=True, slots=True)
class Window:
    """Ticks of a run, from `first` up to `last`, which is not in it."""

    run: Run
    first: int
    last: int

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(self.run.time[self.last - 1] - self.run.time[self.first])


def read_run(path: Path, joint_names: Sequence[str]) -> Run:
    """Read a recording of this program.

    Raises:
        InputError: it cannot be read, has no ticks, or is another robot's.
    """
    recording = open_recording(path)
    names = recording.header.joint_names
    missing = [name for name in joint_names if name not in names]
    if missing:
        raise InputError(f"{path}: has no joint '{missing[0]}' of the robot; it has: {', '.join(names)}")
    order = [names.index(name) for name in joint_names]
    ticks = [_row(tick) for tick in recording.ticks()]
    if not ticks:
        raise InputError(f"{path}: holds no tick")
    times, states, commands, quaternions = (np.array(column) for column in zip(*ticks, strict=True))
    states, commands = states[..., order], commands[..., order]
    position, velocity, effort, age = np.moveaxis(states, 1, 0)
    return Run(path.name, times, position, velocity, effort, age, commands, quaternions)


def _row(tick: TickRecord) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    state, command = tick.input.state, tick.output.command
    measured = np.stack([state.joint_position, state.joint_velocity, state.joint_effort, state.joint_age])
    return (
        float(state.time),
        measured,
        np.stack([getattr(command, name) for name in COMMAND_FIELDS]),
        state.imu_quaternion,
    )


def stretches(run: Run) -> Iterator[tuple[int, int]]:
    """Yield where a run has no gap, every joint is heard, and a stiffness holds it: what a simulation can follow."""
    heard = np.isfinite(run.position) & (run.age <= STALE) & (run.command[:, 3] > 0.0)
    usable: BoolArray = np.asarray(heard.all(axis=1))
    period = float(np.quantile(np.diff(run.time), 0.9)) if len(run.time) > 1 else 1.0
    joined = np.asarray(np.diff(run.time, prepend=run.time[0] - period) <= _GAP * period)
    first = 0
    for i in range(len(run.time) + 1):
        if i == len(run.time) or not usable[i] or not joined[i]:
            if i > first and run.time[i - 1] - run.time[first] >= _SHORTEST:
                yield first, i
            first = i if i < len(run.time) and usable[i] else i + 1


def windows(run: Run, share: tuple[float, float] = (0.0, 1.0)) -> list[Window]:
    """Return the windows in a share of the time that a run's stretches cover."""
    spans = list(stretches(run))
    total = sum(float(run.time[b - 1] - run.time[a]) for a, b in spans)
    low, high = (total * end for end in share)
    found, before = [], 0.0
    for a, b in spans:
        start, end = float(run.time[a]), float(run.time[b - 1])
        begin, finish = max(start, start + low - before), min(end, start + high - before)
        before += end - start
        if finish - begin < _SHORTEST:
            continue
        count = max(round((finish - begin) / _WINDOW), 1)
        edges = np.searchsorted(run.time, np.linspace(begin, finish, count + 1))
        edges[-1] = min(edges[-1] + 1, b)
        found += [Window(run, int(i), int(j)) for i, j in pairwise(edges)]
    return found
