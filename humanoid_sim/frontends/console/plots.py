"""Plots of a page: charts of a session's values in the latest seconds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from viser import GuiApi, GuiUplotHandle, uplot

from humanoid_sim.frontends.attach import Source
from humanoid_sim.messages import TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.recording.topics import read_labels

_ROWS = 1000  # 20 s at 50 rows a second
_PERIOD = 0.02  # s of the robot's time, the shortest between two rows
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

    def __init__(self, source: Source) -> None:
        self.charts: dict[str, Chart] = {}
        self._width = 1  # the time
        for name in source.header.joint_names:
            self._add(f"{name} position, rad", ("position", "command"))
        for kind, unit in (("velocity", "rad/s"), ("effort", "N·m")):
            for name in source.header.joint_names:
                self._add(f"{name} {kind}, {unit}", (kind,))
        self._add("loop, ms", ("tick time",))
        labels = read_labels(source.header)
        for term, width in source.header.observation_terms:
            names = labels.observation.get(term, ())
            self._add(f"observed {term}", names if len(names) == width else tuple(map(str, range(width))))
        self._observed: FloatArray = np.full(sum(width for _, width in source.header.observation_terms), np.nan)
        self._history: FloatArray = np.full((_ROWS, self._width), np.nan)
        self._shown: list[tuple[Chart, GuiUplotHandle]] = []

    def _add(self, name: str, series: tuple[str, ...]) -> None:
        self.charts[name] = Chart(name, series, slice(self._width, self._width + len(series)))
        self._width += len(series)

    def add_controls(self, gui: GuiApi) -> None:
        """Add the controls to a GUI; charts come below them."""
        add = gui.add_dropdown("Add a plot", ("…", *self.charts))
        clear = gui.add_button("Remove all plots")
        folder = gui.add_folder("Plots")

        def added(_: object) -> None:
            chart = self.charts.get(add.value)
            if chart is not None:
                with folder:
                    self._shown.append((chart, _uplot(gui, chart)))
                add.value = "…"

        def cleared(_: object) -> None:
            shown, self._shown = self._shown, []
            for _, handle in shown:
                handle.remove()

        add.on_update(added)
        clear.on_click(cleared)

    def take(self, record: TickRecord) -> None:
        """Take a tick; values are kept at most 50 times a second."""
        state, step = record.input.state, record.output.policy_step
        if step is not None and step.observation.shape == self._observed.shape:
            self._observed = step.observation.astype(np.float64)
        last = self._history[-1, 0]
        if state.time < last:  # time begins again after a reactivation
            self._history[:] = np.nan
        elif state.time < last + _PERIOD - 1e-6:
            return
        joints = np.column_stack([state.joint_position, record.output.command.position])
        parts = [[state.time], joints.ravel(), state.joint_velocity, state.joint_effort, [1e3 * record.duration]]
        self._history[:-1] = self._history[1:]
        self._history[-1] = np.concatenate([*parts, self._observed])

    def show(self) -> None:
        """Draw the charts anew."""
        rows = self._history[np.isfinite(self._history[:, 0])]
        for chart, handle in self._shown if len(rows) else ():
            handle.data = (rows[:, 0], *rows[:, chart.columns].T)


def _uplot(gui: GuiApi, chart: Chart) -> GuiUplotHandle:
    lines = [uplot.Series(label=name, stroke=_COLORS[i % len(_COLORS)], width=1) for i, name in enumerate(chart.series)]
    axes = tuple(uplot.Axis(stroke="#999", grid={"stroke": "#8883"}) for _ in range(2))
    return gui.add_uplot(
        tuple(np.zeros(1) for _ in range(1 + len(lines))),
        (uplot.Series(label="s"), *lines),
        title=chart.name,
        scales={"x": uplot.Scale(time=False)},
        axes=axes,
        aspect=1.8,
    )
