"""Plots of a page: charts of a session's values, and a bounded history of them."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.evaluation.run_figures import MotionErrors
from humanoid_sim.evaluation.step_metrics import METRICS
from humanoid_sim.frontends.console.state import base_velocity
from humanoid_sim.messages import Mode, SessionHeader, TickRecord
from humanoid_sim.mit import VELOCITY_COMMAND, FloatArray
from humanoid_sim.recording.topics import Labels, read_labels
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.floating_base import BaseObserver
from humanoid_sim.stack import no_policy, recorded_policy

MOST_CHARTS = 24
"""That one page plots at once."""
_ROWS = 15_000
"""That are kept, for pages that are opened late."""
_PERIOD = 0.02
"""s, the shortest between two rows: 50 a second, and so the last five minutes of the robot's time at least."""
_MOST_SERIES = 20
"""Largest number of series in one chart; more are spread over several charts."""
_SHOWN_AS = {"m": ("mm", 1e3), "rad": ("°", float(np.degrees(1.0)))}
_FRAME_TIME = 145e-6
"""s that a CAN frame of 8 bytes takes at 1 Mbit/s."""
_HEAD = struct.Struct("<3d")
"""A message to a page begins with: number of the chart, of its rows, and 1 if they replace what it has."""


@dataclass(frozen=True, slots=True)
class Chart:
    """Values that are drawn together, against the robot's time."""

    group: str
    name: str
    unit: str
    series: tuple[str, ...]


class History:
    """The latest rows of a table with a column of times, numbered from 1."""

    def __init__(self, width: int) -> None:
        """Begin empty; `width` columns beside the time."""
        self._rows: FloatArray = np.full((_ROWS, 1 + width), np.nan)
        self.newest = 0
        self.oldest = 1
        """Number of the first row that is still there."""

    @property
    def time(self) -> float:
        """Return the time of the newest row, s; minus infinity without any."""
        return float(self._rows[self.newest % _ROWS, 0]) if self.newest >= self.oldest else -np.inf

    def add(self, time: float, values: FloatArray) -> None:
        """Add a row, shape (width,). Where time begins again, as after a reactivation, what was before is forgotten."""
        if time <= self.time:
            self.oldest = self.newest + 1
        self.newest += 1
        self.oldest = max(self.oldest, self.newest - _ROWS + 1)
        row = self._rows[self.newest % _ROWS]
        row[0], row[1:] = time, values

    def since(self, number: int, columns: slice) -> FloatArray:
        """Shape (1 + c, k): time and c columns of the k rows after a number that are still there, oldest first."""
        wanted = np.arange(max(number + 1, self.oldest), self.newest + 1) % _ROWS
        return np.vstack([self._rows[wanted, 0], self._rows[:, 1:][:, columns][wanted].T])


class Plots:
    """All that a session's page can plot."""

    def __init__(
        self,
        header: SessionHeader,
        description: RobotDescription,
        channels: Sequence[str] = (),
        base: BaseObserver | None = None,
    ) -> None:
        """Find out what there is; `channels` are the CAN buses, none in simulation.

        Raises `InputError` if the header is damaged.
        """
        self._channels, self._base = tuple(channels), base
        self._joints = len(header.joint_names)
        self._widths = [width for _, width in header.observation_terms]
        loaded = recorded_policy(header, no_policy)
        self._tracking = None if loaded is None else MotionErrors.of(description, loaded)
        self.charts: tuple[Chart, ...] = ()
        self._columns: list[slice] = []
        width = 0
        names = () if self._tracking is None else self._tracking.names
        errors = [(name, METRICS[name].unit) for name in names]
        for chart, columns in _charts(header, errors, self._channels, has_base=base is not None):
            self.charts += (chart,)
            self._columns.append(slice(width, width + columns))
            width += columns
        self.history = History(width)
        self._observation: FloatArray = np.full(sum(self._widths), np.nan)
        self._slowest = self._missed = 0.0

    def add(self, record: TickRecord, loads: Mapping[str, float]) -> None:
        """Take a tick; `loads` of the buses, 0 to 1."""
        state, output = record.input.state, record.output
        self._slowest = max(self._slowest, record.duration)
        self._missed += record.overrun
        step = output.policy_step
        if step is not None and step.observation.shape == self._observation.shape:
            self._observation = step.observation.astype(np.float64)
            if self._tracking is not None:
                self._tracking.update(step.frame, state)
        is_driven = output.control_mode.mode is Mode.LOCOMOTION
        time, last = float(state.time), self.history.time
        if last <= time < last + _PERIOD - 1e-6:
            return
        joints = np.column_stack(
            [state.joint_position, output.command.position, state.joint_velocity, state.joint_effort]
        )
        values: list[npt.ArrayLike] = [
            joints[:, :2].ravel(),
            joints[:, 2],
            joints[:, 3],
            self._motion(record),
            self._errors(is_driven=is_driven),
            [1e3 * self._slowest, self._missed],
            [100.0 * loads.get(channel, np.nan) for channel in self._channels],
            self._observation if is_driven else np.full_like(self._observation, np.nan),
        ]
        self.history.add(time, np.concatenate([np.asarray(part, np.float64) for part in values]))
        self._slowest = 0.0

    def _motion(self, record: TickRecord) -> FloatArray:
        """Return the velocity of a floating base, each component beside what is commanded."""
        if self._base is None:
            return np.empty(0)
        state = record.input.state
        command = state.extern.get(VELOCITY_COMMAND)
        wanted = np.full(3, np.nan) if command is None else command.at(state.time)
        return np.column_stack([base_velocity(record, self._base), wanted]).ravel()

    def _errors(self, *, is_driven: bool) -> FloatArray:
        if self._tracking is None:
            return np.empty(0)
        factors = np.array([_SHOWN_AS[METRICS[name].unit][1] for name in self._tracking.names])
        latest = self._tracking.latest if is_driven else None
        return np.full(len(factors), np.nan) if latest is None else latest * factors

    def message(self, chart: int, number: int) -> bytes:
        """Return the rows of a chart after a number, for a page: the head, the times, and each series, as float64."""
        table = self.history.since(number, self._columns[chart])
        is_whole = number < self.history.oldest
        return _HEAD.pack(chart, table.shape[1], float(is_whole)) + np.ascontiguousarray(table, "<f8").tobytes()


class Watch:
    """Charts that one page plots, and the rows it was sent so far. A slow page skips rows that are no longer there."""

    def __init__(self, plots: Plots) -> None:
        self._plots = plots
        self._told: dict[int, int] = {}

    def choose(self, charts: object) -> str:
        """Plot these, by their numbers, from here on; why not, if it is refused."""
        last = len(self._plots.charts) - 1
        chosen: list[Any] = charts if isinstance(charts, list) and len(charts) <= MOST_CHARTS else [None]
        if not all(type(chart) is int and 0 <= chart <= last for chart in chosen):
            return f"plots not understood, expected at most {MOST_CHARTS} numbers from 0 to {last}"
        self._told = {chart: self._told.get(chart, 0) for chart in chosen}
        return ""

    def due(self) -> Iterator[bytes]:
        """Yield what the page has to be told now."""
        for chart, number in list(self._told.items()):
            newest = self._plots.history.newest
            if newest > number:
                self._told[chart] = newest
                yield self._plots.message(chart, number)


def bus_loads(before: Mapping[str, Any] | None, now: Mapping[str, Any] | None) -> dict[str, float]:
    """By bus the load, 0 to 1, between two of the robot's statuses in the feed; none in simulation."""
    if before is None or now is None or now["elapsed"] <= before["elapsed"]:
        return {}
    earlier = {channel["source"]: _frames(channel) for channel in before["channels"]}
    return {
        channel["source"]: _FRAME_TIME
        * (_frames(channel) - earlier[channel["source"]])
        / (now["elapsed"] - before["elapsed"])
        for channel in now["channels"]
        if channel["source"] in earlier
    }


def _frames(channel: Mapping[str, Any]) -> int:
    return int(channel["sent"] + channel["received"])


def _charts(
    header: SessionHeader, errors: Sequence[tuple[str, str]], channels: tuple[str, ...], *, has_base: bool
) -> Iterator[tuple[Chart, int]]:
    """Charts and how many columns each takes, in the order of `Plots.add`."""
    for name in header.joint_names:
        yield Chart("position and command", name, "rad", ("position", "command")), 2
    for group, unit in (("velocity", "rad/s"), ("effort", "N·m")):
        for name in header.joint_names:
            yield Chart(group, name, unit, (group,)), 1
    if has_base:
        for name, unit in (("forward", "m/s"), ("left", "m/s"), ("turn left", "rad/s")):
            yield Chart("base velocity", name, unit, ("measured", "commanded")), 2
    for name, unit in errors:
        yield Chart("tracking error", name, _SHOWN_AS[unit][0], ("error",)), 1
    yield Chart("loop", "tick time", "ms", ("slowest",)), 1
    yield Chart("loop", "missed deadlines", "since the console began", ("missed",)), 1
    for channel in channels:
        yield Chart("bus load", channel, "%", ("load",)), 1
    yield from _observed("observation", header.observation_terms, read_labels(header))


def _observed(group: str, terms: Sequence[tuple[str, int]], labels: Labels) -> Iterator[tuple[Chart, int]]:
    for term, width in terms:
        names = labels.observation.get(term, ())
        series = names if len(names) == width else tuple(str(i) for i in range(width))
        yield from _spread(group, term, "as observed", series)


def _spread(group: str, name: str, unit: str, series: tuple[str, ...]) -> Iterator[tuple[Chart, int]]:
    """One chart, or several where there are too many lines for one."""
    for first in range(0, len(series), _MOST_SERIES):
        part = series[first : first + _MOST_SERIES]
        which = "" if len(series) <= _MOST_SERIES else f", {first + 1} to {first + len(part)}"
        yield Chart(group, name + which, unit, part), len(part)
