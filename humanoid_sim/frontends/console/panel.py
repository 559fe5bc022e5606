"""The GUI of the page: buttons, sliders, tables and plots, and the facts that the overlay shows."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from time import monotonic, time
from typing import Any

from humanoid_sim.controllers.fsm import merge_safety, transition
from humanoid_sim.evaluation.failure import describe_fall, has_fallen
from humanoid_sim.frontends.attach import Source
from humanoid_sim.frontends.console.operator import Operator
from humanoid_sim.frontends.console.plots import Plots
from humanoid_sim.frontends.console.scene import Scene
from humanoid_sim.messages import Intent, TickRecord
from humanoid_sim.recording.header import json_document
from humanoid_sim.session.reactivation import REACTIVATE, reactivation_refusal
from humanoid_sim.simulation.floating_base import BaseObserver
from humanoid_sim.stack import no_policy, rebuild_supervisor

_CONFIRM = 5.0  # s within which REACTIVATE is pressed again
_EVENTS = 40  # that are shown
_MOVED = 0.5  # s for which a slider that an operator moved is left alone
_PUSHES = {"+x": (1, 0), "−x": (-1, 0), "+y": (0, 1), "−y": (0, -1)}  # the world's; a robot faces +x at its start
_WORDS = tuple(intent for intent in Intent if intent is not Intent.DAMP)  # DAMP is the overlay's


class Panel:
    """For one session or robot elsewhere; `operator` is None where nothing is commanded."""

    def __init__(self, source: Source, scene: Scene, operator: Operator | None) -> None:
        self._source, self._scene, self._operator, self._gui = source, scene, operator, scene.server.gui
        self._is_simulated = operator is not None and not source.is_hardware
        is_floating = source.description.is_floating
        self._base = BaseObserver(source.model(), source.description) if self._is_simulated and is_floating else None
        self._standing_height = 0.0
        self._is_free: bool | None = None
        self._plots = Plots(source, self._base)
        self._events: deque[str] = deque(maxlen=_EVENTS)
        self._mode = ""
        self._status = source.status()
        self._build()

    def _build(self) -> None:
        gui = self._gui
        gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(380)
        gui.set_panel_label(self._source.description.name)
        self._summary = gui.add_html("")
        if self._operator is not None:
            self._build_commands(self._operator)
        with gui.add_folder("View", expand_by_default=False):
            self._scene.add_switches()
        with gui.add_folder("Joints", expand_by_default=False):
            self._joints = gui.add_html("")
        with gui.add_folder("Events"):
            if self._operator is not None:
                gui.add_button("Mark this moment").on_click(lambda _: self._ask("mark moment"))
            self._event_list = gui.add_html("")
        panel = gui.add_panel()
        with panel.add_tab("Plots"):
            self._plots.add_controls(gui)
        panel.dock_left()
        panel.set_width(360)
        panel.minimize()

    def _build_commands(self, operator: Operator) -> None:
        gui = self._gui
        self._supervisor = rebuild_supervisor(self._source.header, no_policy)
        self._buttons = {intent: gui.add_button(intent.name) for intent in _WORDS}
        for intent, button in self._buttons.items():
            button.on_click(lambda _, word=intent.value: self._ask(word))
        self._armed = -math.inf
        self._again = gui.add_button("RESET" if self._is_simulated else "REACTIVATE")
        self._again.on_click(lambda _: self._reactivate())
        self._answer = gui.add_html("")
        self._velocity: list[Any] = []
        if operator.speeds is not None:
            with gui.add_folder("Velocity"):
                names = ("forward, m/s", "left, m/s", "turn left, rad/s")
                for axis, (name, (low, high)) in enumerate(zip(names, operator.speeds.tolist(), strict=True)):
                    self._velocity.append(self._slider(name, low, high, operator.steer, axis))
                gui.add_button("Stop").on_click(lambda _: operator.do(operator.stop))
        with gui.add_folder("Move one joint in REMOTE", expand_by_default=False):
            joint = gui.add_dropdown("Joint", self._source.header.joint_names)
            gui.add_button("Move this joint").on_click(lambda _: operator.do(operator.take, joint.value))
            gui.add_button("Let go").on_click(lambda _: operator.do(operator.leave))
            self._moved = gui.add_html("")
            names = ("position, rad", "K_p, N·m/rad", "K_d, N·m·s/rad")
            self._goals = [self._slider(name, -1.0, 1.0, operator.set_goal, row) for row, name in enumerate(names)]
        bodies = (self._status.get("simulation") or {}).get("bodies", ())
        if bodies:
            with gui.add_folder("Push", expand_by_default=False):
                body, to = gui.add_dropdown("Body", tuple(bodies)), gui.add_dropdown("To", tuple(_PUSHES))
                speed = gui.add_number("By, m/s", 0.5, min=0.1, max=10.0, step=0.1)
                push_button = gui.add_button("Push")

            def push(_: object) -> None:
                x, y = _PUSHES[to.value]
                self._ask(f"push {x * speed.value},{y * speed.value} {body.value}")

            push_button.on_click(push)

    def _slider(self, name: str, low: float, high: float, action: Any, index: int) -> Any:
        """Add a slider that calls `action(index, value)` when an operator moves it."""
        operator = self._operator
        assert operator is not None
        slider = self._gui.add_slider(name, low, high, 0.01, min(max(0.0, low), high))

        def moved(event: Any) -> None:
            if event.client is not None:  # not by this program
                operator.do(action, index, slider.value)

        slider.on_update(moved)
        return slider

    def _ask(self, word: str) -> None:
        assert self._operator is not None
        self._operator.do(self._operator.ask, word, self._operator.gate.seen())

    def _reactivate(self) -> None:
        is_confirmed = self._is_simulated or monotonic() - self._armed < _CONFIRM
        self._armed = -math.inf if is_confirmed else monotonic()
        if is_confirmed:
            self._ask("reset" if self._is_simulated else REACTIVATE)

    def take(self, record: TickRecord) -> None:
        """Take a tick, of which every one must be seen."""
        self._scene.take(record)
        self._plots.take(record)
        output, control = record.output, record.output.control_mode
        news = [*output.refusals, *(fault.message for fault in output.faults)]
        mode = f"{control.mode.name} ({control.controller_name})"
        if mode != self._mode:
            self._mode = mode
            news.insert(0, f"{mode}: {control.status_message}")
        self._note(float(record.input.state.time), news)
        if self._base is not None and record.qpos is not None and control.mode.is_free is not self._is_free:
            self._is_free = control.mode.is_free
            self._standing_height = self._base.standing_height(record.qpos)

    def _note(self, time: float, texts: Iterable[str]) -> None:
        self._events.extendleft(f"{time:.2f} s  {text}" for text in texts)

    def show(self) -> dict[str, Any]:
        """Draw the newest tick; returns what the overlay shows."""
        tick, operator = self._source.latest, self._operator
        for event in self._source.events():
            self._note(event.time, [event.text])
        if tick is None:
            return {"age": 0.0}
        self._status = self._source.status()
        self._plots.show()
        record = tick.record
        fallen = self._fallen(record)
        with self._scene.server.atomic():
            self._summary.content = _lines(self._summary_lines(record, fallen))
            self._joints.content = self._joint_table(record)
            self._event_list.content = _lines(self._events)
            if operator is not None:
                self._show_commands(operator, record)
        control = record.output.control_mode
        return {
            "mode": control.mode.name,
            "reason": control.status_message,
            "fallen": bool(fallen),
            "stop": "; ".join(text for text in (fallen, operator.let_go if operator else "") if text),
            "stamp": str(tick.stamp),  # JavaScript's numbers do not hold it
            "age": tick.age,
        }

    def _fallen(self, record: TickRecord) -> str:
        if self._base is None or record.qpos is None:
            return ""
        base = self._base.at(record.qpos, None)
        is_down = has_fallen(base, self._standing_height)
        return f"the robot {describe_fall(base, self._standing_height)}" if is_down else ""

    def _summary_lines(self, record: TickRecord, fallen: str) -> list[str]:
        standby, recording = record.output.standby, self._status.get("recording") or {}
        policy = json_document(self._source.header, "settings").get("policy") or "none"
        lines = [f"{record.output.control_mode.controller_name}, {record.input.state.time:.1f} s"]
        if standby is not None:
            pose = f"pose {standby.current_segment + 1} of {standby.total_segments}, {100 * standby.progress:.0f} %"
            lines.append("pose reached" if standby.is_finished else pose)
        lines.append(f"policy {Path(str(policy)).name}")
        if recording:
            error = recording["error"]
            lines.append(f"recording stopped: {error}" if error else f"recording {recording['file']}")
        lines += [f"{what} from {who}" for what, who in self._status.get("owners", {}).items() if who]
        lines.append(fallen)
        for status in record.input.safety:
            parts = (status.level.name, status.source, status.message, *(str(flag.name) for flag in status.flags))
            lines.append(" · ".join(filter(None, parts)))
        return lines

    def _joint_table(self, record: TickRecord) -> str:
        state, robot, names = record.input.state, self._status.get("robot"), self._source.header.joint_names
        heads = ["", "rad", "command", "rad/s", "N·m"]
        columns = [state.joint_position, record.output.command.position, state.joint_velocity, state.joint_effort]
        rows = [[name, *(_number(column[i], 2) for column in columns)] for i, name in enumerate(names)]
        if robot is not None:
            heads += ["°C", "ms", "faults"]
            for row, name, age in zip(rows, names, state.joint_age.tolist(), strict=True):
                row += [_number(robot["temperature"].get(name, math.nan), 0), _number(1e3 * age, 0)]
                row.append(", ".join(robot["faults"].get(name, ())))
        return _table(heads, rows)

    def _show_commands(self, operator: Operator, record: TickRecord) -> None:
        control, standby = record.output.control_mode, record.output.standby
        is_finished = standby is not None and standby.is_finished
        safety, available = merge_safety(record.input.safety), self._supervisor.controllers
        for intent, button in self._buttons.items():
            unready = self._supervisor.unready(intent, record.input)
            change = transition(control.controller_name, safety, intent, is_finished, available, unready)
            _set(button, color="gray" if change.refusal else "blue", hint=change.refusal or None)
        if not self._is_simulated:
            refusal = reactivation_refusal(control.mode)
            is_armed = monotonic() - self._armed < _CONFIRM
            _set(self._again, label="REACTIVATE: press again" if is_armed else "REACTIVATE", hint=refusal or None)
        _set(self._answer, content=_lines([operator.answer]))
        for axis, slider in enumerate(self._velocity):
            _follow(slider, operator.velocity[axis])
        sliders, text = operator.sliders, "no joint is moved"
        if sliders is not None and sliders.joint is not None:
            position = record.input.state.joint_position[sliders.joint]
            text = f"{self._source.header.joint_names[sliders.joint]} is at {position:.2f} rad"
            for slider, goal, (low, high) in zip(self._goals, sliders.goals, sliders.limits, strict=True):
                _set(slider, min=float(low), max=float(high))
                _follow(slider, goal)
        _set(self._moved, content=_lines([text]))


def _set(handle: Any, **values: Any) -> None:
    """Set properties that have changed."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)


def _follow(slider: Any, value: float) -> None:
    """Put a slider that nobody moves where it belongs."""
    if time() - slider.update_timestamp > _MOVED and abs(slider.value - value) > slider.step:
        slider.value = float(value)


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "–"


def _lines(lines: Iterable[str]) -> str:
    rows = "".join(f"<div style='border-top: 1px solid #8883'>{escape(line)}</div>" for line in lines if line)
    return f"<div style='padding: 0 1em; font-size: 0.85em; overflow-wrap: anywhere'>{rows}</div>"


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    first = "".join(f"<th>{escape(head)}</th>" for head in heads)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    style = "font-size: 0.75em; width: 100%; padding: 0 1em; font-variant-numeric: tabular-nums"
    return f"<table style='{style}'><tr>{first}</tr>{body}</table>"
