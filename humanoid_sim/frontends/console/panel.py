"""The GUI of the page: buttons, sliders and plots, and the facts that the overlay shows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from time import time
from typing import Any

from humanoid_sim.frontends.attach import Source
from humanoid_sim.frontends.console.operator import Operator
from humanoid_sim.frontends.console.plots import Plots
from humanoid_sim.frontends.console.scene import Scene
from humanoid_sim.frontends.console.sliders import slider_limits
from humanoid_sim.messages import Intent, TickRecord
from humanoid_sim.recording.header import json_document
from humanoid_sim.session.requests import REACTIVATE

_MOVED = 0.5  # s for which a slider that an operator moved is left alone


class Panel:
    """For one session or robot elsewhere; `operator` is None where nothing is commanded."""

    def __init__(self, source: Source, scene: Scene, operator: Operator | None) -> None:
        self._source, self._scene, self._operator, self._gui = source, scene, operator, scene.server.gui
        self._plots, self._has_push = Plots(source), False
        gui = self._gui
        gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        gui.set_panel_label(source.header.robot)
        self._summary = gui.add_html("")
        self._velocity: list[Any] = []
        self._goals: list[Any] = []
        if operator is not None:
            self._add_requests(operator)
            self._add_velocity(operator)
            self._add_joints(operator)
        self._plots.add_controls(gui)

    def _add_requests(self, operator: Operator) -> None:
        gui, is_hardware = self._gui, self._source.is_hardware
        words = [intent.value for intent in Intent if intent is not Intent.DAMP]  # DAMP is the overlay's
        for word in (*words, REACTIVATE if is_hardware else "reset"):
            gui.add_button(word.upper()).on_click(lambda _, word=word: operator.request(word))

    def _add_push(self, operator: Operator, bodies: Sequence[str]) -> None:
        gui, self._has_push = self._gui, True
        with gui.add_folder("Push", expand_by_default=False):
            body = gui.add_dropdown("Body", tuple(bodies))
            x, y = (gui.add_number(f"{axis}, m/s", value, step=0.1) for axis, value in (("x", 0.5), ("y", 0.0)))
            push = gui.add_button("Push")
        push.on_click(lambda _: operator.request(f"push {x.value},{y.value} {body.value}"))

    def _add_velocity(self, operator: Operator) -> None:
        if operator.speeds is None:
            return
        with self._gui.add_folder("Velocity"):
            names = ("forward, m/s", "left, m/s", "turn left, rad/s")
            for axis, (name, (low, high)) in enumerate(zip(names, operator.speeds.tolist(), strict=True)):
                self._velocity.append(self._slider(name, low, high, operator.steer, axis))
            self._gui.add_button("Stop").on_click(lambda _: operator.do(operator.stop))

    def _add_joints(self, operator: Operator) -> None:
        gui, robot = self._gui, self._source.description
        with gui.add_folder("Joints in REMOTE", expand_by_default=False):
            gui.add_button("Move the joints").on_click(lambda _: operator.do(operator.take))
            gui.add_button("Let go").on_click(lambda _: operator.do(operator.leave))
            limits = zip(robot.joint_names, slider_limits(robot).tolist(), strict=True)
            self._goals = [
                self._slider(name, low, high, operator.set_goal, joint)
                for joint, (name, (low, high)) in enumerate(limits)
            ]

    def _slider(self, name: str, low: float, high: float, action: Callable[..., None], index: int) -> Any:
        """Add a slider that calls `action(index, value)` when an operator moves it."""
        operator = self._operator
        assert operator is not None
        slider = self._gui.add_slider(name, low, high, 0.01, min(max(0.0, low), high))

        def moved(event: Any) -> None:
            if event.client is not None:  # not by this program
                operator.do(action, index, slider.value)

        slider.on_update(moved)
        return slider

    def take(self, record: TickRecord) -> None:
        """Take a tick, of which every one must be seen."""
        self._scene.take(record)
        self._plots.take(record)

    def show(self) -> dict[str, Any]:
        """Draw the newest tick; returns what the overlay shows."""
        tick, operator = self._source.latest, self._operator
        if tick is None:
            return {"age": 0.0}
        self._plots.show()
        with self._scene.server.atomic():
            lines = self._summary_lines(tick.record)
            rows = "".join(f"<div style='border-top: 1px solid #8883'>{escape(line)}</div>" for line in lines)
            self._summary.content = f"<div style='padding: 0 1em; font-size: 0.85em'>{rows}</div>"
            if operator is not None:
                self._show_sliders(operator)
                bodies = (self._source.status().get("simulation") or {}).get("bodies", ())
                if bodies and not self._has_push:
                    self._add_push(operator, bodies)
        control = tick.record.output.control_mode
        return {
            "control": operator is not None,
            "mode": control.mode.name,
            "reason": control.status_message,
            "stamp": str(tick.stamp),  # JavaScript's numbers do not hold it
            "age": tick.age,
        }

    def _summary_lines(self, record: TickRecord) -> list[str]:
        status, standby = self._source.status(), record.output.standby
        policy = json_document(self._source.header, "settings").get("policy") or "none"
        lines = [f"{record.output.control_mode.controller_name}, {record.input.state.time:.1f} s"]
        if standby is not None:
            pose = f"pose {standby.current_segment + 1} of {standby.total_segments}, {100 * standby.progress:.0f} %"
            lines.append("pose reached" if standby.is_finished else pose)
        lines.append(f"policy {Path(str(policy)).name}")
        recording = status.get("recording")
        if recording:
            lines.append(f"recording {recording['error'] or recording['file']}")
        lines += [f"{what} from {who}" for what, who in status.get("owners", {}).items() if who]
        for one in record.input.safety:
            parts = (one.level.name, one.source, one.message, *(str(flag.name) for flag in one.flags))
            lines.append(" · ".join(filter(None, parts)))
        return [*lines, self._operator.answer] if self._operator is not None else lines

    def _show_sliders(self, operator: Operator) -> None:
        for slider, value in zip(self._velocity, operator.velocity, strict=False):
            _follow(slider, value)
        if operator.sliders is not None:
            for slider, goal in zip(self._goals, operator.sliders.goals, strict=True):
                _follow(slider, goal)


def _follow(slider: Any, value: float) -> None:
    """Put a slider that nobody moves where it belongs."""
    if time() - slider.update_timestamp > _MOVED and abs(slider.value - value) > slider.step:
        slider.value = float(value)
