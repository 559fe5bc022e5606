"""Plots of a page: charts of a session's values in the latest seconds."""

from __future__ import annotations

import numpy as np
from viser import GuiApi, GuiUplotHandle, uplot

from humanoid_sim.frontends.attach import Source
from humanoid_sim.messages import TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.recording.header import LABELS_DOCUMENT, json_document

_ROWS = 1000  # 20 s at 50 rows a second
_PERIOD = 0.02  # s of the robot's time, the shortest between two rows
_COLORS = ("#7fb4ff", "#ffaa3c", "#40c878", "#ff6b6b", "#c792ea", "#e6e07a", "#5fd3d3", "#d0d0d0")


class Plots:
    """Charts that operators choose, for all pages at once: each draws columns of one history against its first."""

    def __init__(self, source: Source) -> None:
        joints, terms = source.header.joint_names, source.header.observation_terms
        labels = json_document(source.header, LABELS_DOCUMENT).get("observation", {})
        charts: dict[str, tuple[str, ...]] = {f"{name} position, rad": ("position", "command") for name in joints}
        charts |= {f"{name} velocity, rad/s": ("velocity",) for name in joints}
        charts |= {f"{name} effort, N·m": ("effort",) for name in joints}
        charts["loop, ms"] = ("tick time",)
        for term, width in terms:
            names = tuple(labels.get(term, ()))
            charts[f"observed {term}"] = names if len(names) == width else tuple(map(str, range(width)))
        ends = 1 + np.cumsum([len(names) for names in charts.values()])
        self.charts = charts  # names of the lines of each
        self._ends = dict(zip(charts, ends.tolist(), strict=True))
        self._observed: FloatArray = np.full(sum(width for _, width in terms), np.nan)
        self._history: FloatArray = np.full((_ROWS, ends[-1]), np.nan)
        self._shown: list[tuple[str, GuiUplotHandle]] = []

    def add_controls(self, gui: GuiApi) -> None:
        """Add a folder with the controls to a GUI; charts come below them."""
        folder = gui.add_folder("Plots", expand_by_default=False)
        with folder:
            add = gui.add_dropdown("Add a plot", ("…", *self.charts))
            clear = gui.add_button("Remove all plots")

        def added(_: object) -> None:
            if add.value in self.charts:
                with folder:
                    self._shown.append((add.value, _uplot(gui, add.value, self.charts[add.value])))
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
        rows = self._history[np.isfinite(self._history[:, 0])]
        for name, handle in self._shown if len(rows) else ():
            end = self._ends[name]
            handle.data = (rows[:, 0], *rows[:, end - len(self.charts[name]) : end].T)


def _uplot(gui: GuiApi, title: str, names: tuple[str, ...]) -> GuiUplotHandle:
    lines = [uplot.Series(label=name, stroke=_COLORS[i % len(_COLORS)], width=1) for i, name in enumerate(names)]
    return gui.add_uplot(
        tuple(np.zeros(1) for _ in range(1 + len(lines))),
        (uplot.Series(label="s"), *lines),
        title=title,
        scales={"x": uplot.Scale(time=False)},
        axes=tuple(uplot.Axis(stroke="#999", grid={"stroke": "#8883"}) for _ in range(2)),
        aspect=1.8,
    )
