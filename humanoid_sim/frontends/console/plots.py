"""Plots of a page: charts of a session's values, and the latest minutes of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from viser import GuiApi, GuiUplotHandle, uplot

from humanoid_sim.frontends.attach import Source
from humanoid_sim.messages import Mode, TickRecord
from humanoid_sim.mit import VELOCITY_COMMAND, FloatArray
from humanoid_sim.recording.topics import read_labels
from humanoid_sim.simulation.floating_base import BaseObserver

_ROWS = 15_000  # five minutes at 50 rows a second
_PERIOD = 0.02  # s of the robot's time, the shortest between two rows
_SPANS = {"5 s": 5.0, "20 s": 20.0, "60 s": 60.0, "all": np.inf}
_POINTS = 1500  # drawn of one chart at most
_MOST_SERIES = 20  # in one chart; more are spread over several charts
_COLORS = ("#7fb4ff", "#ffaa3c", "#40c878", "#ff6b6b", "#c792ea", "#e6e07a", "#5fd3d3", "#d0d0d0")


@dataclass(frozen=True, slots=True)
class Chart:
    """Values that are drawn together, against the robot's time."""

    name: str
    series: tuple[str, ...]
    columns: slice
    """Columns of the history."""


class Plots:
    """Charts that operators choose, for all pages at once."""

    def __init__(self, source: Source, base: BaseObserver | None) -> None:
        """Find out what there is; `base` observes a simulated floating base."""
        self._base = base
        names, terms = source.header.joint_names, source.header.observation_terms
        self.charts: dict[str, Chart] = {}
        self._width = 1  # the time
        for name in names:
            self._add(f"{name} position, rad", ("position", "command"))
        for kind in ("velocity, rad/s", "effort, N·m"):
            for name in names:
                self._add(f"{name} {kind}", (kind.partition(",")[0],))
        self._add("loop, ms", ("tick time",))
        for name in ("forward, m/s", "left, m/s", "turn left, rad/s") if base is not None else ():
            self._add(f"base velocity {name}", ("measured", "commanded"))
        labels = read_labels(source.header)
        for term, width in terms:
            series = labels.observation.get(term, ())
            series = series if len(series) == width else tuple(map(str, range(width)))
            for first in range(0, width, _MOST_SERIES):
                part = series[first : first + _MOST_SERIES]
                which = "" if width <= _MOST_SERIES else f", {first + 1} to {first + len(part)}"
                self._add(f"observed {term}{which}", part)
        self._unobserved: FloatArray = np.full(sum(width for _, width in terms), np.nan)
        self._observed = self._unobserved
        self._history: FloatArray = np.full((_ROWS, self._width), np.nan)
        self._count = 0
        self._slowest = 0.0
        self._shown: list[tuple[Chart, GuiUplotHandle]] = []

    def _add(self, name: str, series: tuple[str, ...]) -> None:
        self.charts[name] = Chart(name, series, slice(self._width, self._width + len(series)))
        self._width += len(series)

    def add_controls(self, gui: GuiApi) -> None:
        """Add the controls to a GUI; charts come below them."""
        add = gui.add_dropdown("Add a plot", ("…", *self.charts))
        self._span = gui.add_dropdown("Show", tuple(_SPANS), initial_value="20 s")
        self._frozen = gui.add_checkbox("Freeze", False)
        clear = gui.add_button("Remove all plots")
        folder = gui.add_folder("Plots")

        def added(_: object) -> None:
            chart = self.charts.get(add.value)
            if chart is not None:
                with folder:
                    self._shown.append((chart, self._chart(gui, chart)))
                add.value = "…"

        def cleared(_: object) -> None:
            shown, self._shown = self._shown, []
            for _, handle in shown:
                handle.remove()

        add.on_update(added)
        clear.on_click(cleared)

    def _chart(self, gui: GuiApi, chart: Chart) -> GuiUplotHandle:
        lines = [
            uplot.Series(label=name, stroke=_COLORS[i % len(_COLORS)], width=1) for i, name in enumerate(chart.series)
        ]
        data = tuple(np.zeros(1) for _ in range(1 + len(lines)))
        axes = tuple(uplot.Axis(stroke="#999", grid={"stroke": "#8883"}) for _ in range(2))
        scales = {"x": uplot.Scale(time=False)}
        series = (uplot.Series(label="s"), *lines)
        return gui.add_uplot(data, series, title=chart.name, scales=scales, axes=axes, aspect=1.8)

    def take(self, record: TickRecord) -> None:
        """Take a tick; values are kept at most 50 times a second."""
        state, output = record.input.state, record.output
        self._slowest = max(self._slowest, record.duration)
        step = output.policy_step
        if step is not None and step.observation.shape == self._observed.shape:
            self._observed = step.observation.astype(np.float64)
        last = self._history[(self._count - 1) % _ROWS, 0] if self._count else -np.inf
        if state.time < last:  # time begins again after a reactivation
            self._count = 0
        elif state.time < last + _PERIOD - 1e-6:
            return
        is_driven = output.control_mode.mode is Mode.LOCOMOTION
        joints = np.column_stack([state.joint_position, output.command.position])
        row = self._history[self._count % _ROWS]
        parts = [[state.time], joints.ravel(), state.joint_velocity, state.joint_effort, [1e3 * self._slowest]]
        parts.append(self._motion(record))
        np.concatenate([*parts, self._observed if is_driven else self._unobserved], out=row)
        self._count += 1
        self._slowest = 0.0

    def _motion(self, record: TickRecord) -> FloatArray:
        """Return the velocity of a floating base, each component beside what is commanded."""
        if self._base is None or record.qpos is None:
            return np.empty(0)
        state = record.input.state
        command = state.extern.get(VELOCITY_COMMAND)
        wanted = np.full(3, np.nan) if command is None else command.at(state.time)
        return np.column_stack([self._base.sensed(state, record.qpos).planar_velocity, wanted]).ravel()

    def show(self) -> None:
        """Draw the charts anew."""
        if self._frozen.value or not self._count or not self._shown:
            return
        rows = np.arange(max(self._count - _ROWS, 0), self._count) % _ROWS
        times = self._history[rows, 0]
        rows = rows[times >= times[-1] - _SPANS[self._span.value]]
        rows = rows[:: -(-len(rows) // _POINTS)]
        for chart, handle in self._shown:
            handle.data = (self._history[rows, 0], *self._history[rows, chart.columns].T)
