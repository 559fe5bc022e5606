"""The operator's view of a run: every transition with its reason, every refusal, and a line of status."""

from __future__ import annotations

import sys
from collections.abc import Container

from rich.console import Console
from rich.markup import escape

from humanoid_sim.cli import mute_output
from humanoid_sim.controllers.fsm import merge_safety, why_refused
from humanoid_sim.evaluation.run_report import MODE_STYLES
from humanoid_sim.messages import Event, EventKind, Intent, Mode, TickRecord
from humanoid_sim.mit import VELOCITY_COMMAND
from humanoid_sim.recording.sink import WorkerSink
from humanoid_sim.session.keyboard import REACTIVATE_KEY, key_of
from humanoid_sim.session.requests import REACTIVABLE

_CLEAR = "\r\x1b[2K"


class PlayConsole(Console):
    """Standard output; a reader that leaves (`| head -1`) neither ends nor fails a run."""

    def __init__(self, *, quiet: bool = False) -> None:
        # The channel `virtual:b` and the colon after its name are no emoji.
        super().__init__(highlight=False, emoji=False, soft_wrap=not sys.stdout.isatty(), quiet=quiet)

    def on_broken_pipe(self) -> None:
        mute_output()


class ConsoleSink(WorkerSink):
    """Prints transitions, refusals and events; keeps a line of status at the bottom where the output is a terminal."""

    def __init__(
        self,
        console: Console,
        *,
        has_keys: bool = False,
        available: Container[str] = (),  # names of the controllers that exist
    ) -> None:
        super().__init__("console")
        self._console = console
        self._has_line = console.is_terminal and not console.is_dumb_terminal
        self._has_keys, self._available = has_keys, available
        self._mode: Mode | None = None
        self._controller = self._message = ""
        self._time = 0.0
        # Written by the control thread, read by the worker's.
        self._queued = ("", "")
        self._latest: TickRecord | None = None

    def tick(self, record: TickRecord) -> None:
        """Queue a tick that has something to print; of the others only the latest is needed, for the line."""
        output = record.output
        self._latest = record
        shown = (output.control_mode.controller_name, output.control_mode.status_message)
        if shown != self._queued or output.faults or output.refusals:
            self._queued = shown
            super().tick(record)

    def handle_tick(self, record: TickRecord) -> None:
        output, control = record.output, record.output.control_mode
        self._time = float(record.input.state.time)
        bad = [*(f"{fault.controller} failed: {fault.message}" for fault in output.faults), *output.refusals]
        if control.controller_name != self._controller:
            before = "" if self._mode is None else f"{_styled(self._mode)} → "
            self._print(f"{before}{_styled(control.mode)}  [dim]{escape(control.status_message)}[/dim]")
            self._mode, self._controller = control.mode, control.controller_name
        elif bad:
            for text in bad:
                self._print(f"[red]{escape(text)}[/red]")
        elif control.status_message != self._message:
            self._print(f"[dim]{escape(control.status_message)}[/dim]")
        self._message = control.status_message

    def handle_event(self, event: Event) -> None:
        self._time = event.time
        style = "bold red" if event.kind is EventKind.FAILURE else "dim"
        self._print(f"[{style}]{escape(event.text)}[/]")

    def handle_pause(self) -> None:
        if self._latest is not None:  # the last column would make some terminals begin a new line
            self._write_line(self._line(self._latest)[: self._console.width - 1])

    def handle_close(self) -> None:
        self._write_line("")

    def _line(self, record: TickRecord) -> str:
        """Return the line, the most important parts first: a narrow terminal cuts it."""
        control, state, standby = record.output.control_mode, record.input.state, record.output.standby
        is_reached = standby is not None and standby.is_finished
        parts = [control.mode.name]
        if standby is not None:
            percent = 100.0 * (standby.current_segment + standby.progress) / standby.total_segments
            parts.append("reached" if is_reached else f"{percent:.0f} %")
        velocity = state.extern.get(VELOCITY_COMMAND)
        if velocity is not None:
            parts.append("v " + " ".join(f"{value:.2f}" for value in velocity.value))
        parts.append(f"{float(state.time):.1f} s")
        if self._has_keys:
            safety = merge_safety(record.input.safety)
            now = control.controller_name, safety
            granted = [each for each in Intent if not why_refused(*now, each, is_reached, self._available)]
            parts += [f"{key_of(intent)} {intent.name}" for intent in granted]
            if control.mode in REACTIVABLE:
                parts.append(f"{REACTIVATE_KEY} reactivate")
            parts.append("? help")
        return "  ".join(parts)

    def _print(self, text: str) -> None:
        self._write_line("")
        self._console.print(f"[bold]{self._time:8.3f} s[/bold]  {text}", highlight=False)

    def _write_line(self, text: str) -> None:
        if self._has_line:
            self._console.file.write(_CLEAR + text)
            self._console.file.flush()


def _styled(mode: Mode) -> str:
    return f"[{MODE_STYLES[mode]}]{mode.name}[/]"
