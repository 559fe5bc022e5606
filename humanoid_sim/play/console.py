"""What an operator sees while a run goes on: every transition with its reason, every refusal, and a line of status."""

from __future__ import annotations

import math
import sys
from time import monotonic

from rich.console import Console
from rich.markup import escape

from humanoid_sim.cli import mute_output
from humanoid_sim.messages import Event, EventKind, Intent, Mode, TickOutput, TickRecord
from humanoid_sim.play.status_line import MODE_STYLES, StatusLine, Told, possible, status_parts
from humanoid_sim.session.keyboard import key_of
from humanoid_sim.session.reactivation import HOW_TO_REACTIVATE
from humanoid_sim.session.sinks import WorkerSink

_REDRAW = 0.1
"""s between two drawings of the line, if nothing is printed between them."""


class PlayConsole(Console):
    """Standard output; a reader that leaves (`| head -1`) neither ends nor fails a run."""

    def __init__(self) -> None:
        # The channel `virtual:b` and the colon after its name are no emoji.
        super().__init__(highlight=False, emoji=False, soft_wrap=not sys.stdout.isatty())
        self.is_unread = False
        """Its reader has left."""

    def on_broken_pipe(self) -> None:
        """Print nowhere from here on."""
        self.is_unread = True
        mute_output()


class ConsoleSink(WorkerSink):
    """Prints transitions, refusals and events; keeps a line of status at the bottom where the output is a terminal."""

    def __init__(self, console: Console, told: Told) -> None:
        """Prepare.

        Args:
            console: where to print.
            told: what the line needs beside the ticks.
        """
        super().__init__("console", period=0.05)
        self._console = console
        self._told = told
        self._line = StatusLine(console)
        self._mode: Mode | None = None
        self._controller = ""
        self._status = ""
        self._is_reached = False
        self._time = 0.0
        self._drawn = -math.inf
        # Written by the control thread, read by the worker's.
        self._queued_status = ("", "")
        self._queued_reached = False
        self._latest: TickRecord | None = None
        self._frame: int | None = None
        self._overruns = 0

    def follow(self, told: Told) -> None:
        """Know of another policy from here on."""
        self._told, self._frame = told, None

    @property
    def told(self) -> Told:
        """Facts that the line needs in addition to the ticks."""
        return self._told

    def tick(self, record: TickRecord) -> None:
        """Queue a tick that has something to print; of the others only the latest is needed, for the line."""
        output = record.output
        self._latest = record
        self._overruns += record.overrun
        if output.policy_step is not None:
            self._frame = output.policy_step.frame
        status = (output.control_mode.controller_name, output.control_mode.status_message)
        is_new, self._queued_status = status != self._queued_status, status
        is_reached = _is_reached(output)
        has_arrived, self._queued_reached = is_reached and not self._queued_reached, is_reached
        if is_new or has_arrived or output.faults or output.refusals or record.input.intents:
            super().tick(record)

    def handle_tick(self, record: TickRecord) -> None:
        """Print what is new in this tick."""
        output = record.output
        control = output.control_mode
        self._time = float(record.input.state.time)
        bad = [*(f"{fault.controller} failed: {fault.message}" for fault in output.faults), *output.refusals]
        if control.controller_name != self._controller:
            before = f"{_styled(self._mode)} → " if self._mode is not None else ""
            self._print(f"{before}{_styled(control.mode)}  [dim]{escape(control.status_message)}[/dim]")
            self._mode, self._controller = control.mode, control.controller_name
        elif Intent.DAMP in record.input.intents and not self._told.is_driven():
            self._print(f"[red]DAMP has no effect: no motor is driven; {HOW_TO_REACTIVATE}[/red]")
        elif bad:
            for text in bad:
                self._print(f"[red]{escape(text)}[/red]")
        elif control.status_message != self._status:
            self._print(f"[dim]{escape(control.status_message)}[/dim]")
        elif record.input.intents:
            names = ", ".join(intent.name for intent in record.input.intents)
            self._print(f"[dim]{names}: already in {control.mode.name}[/dim]")
        self._status = control.status_message
        is_reached = _is_reached(output)
        if is_reached and not self._is_reached:
            self._print(f"standby reached{self._what_comes_next(record)}")
        self._is_reached = is_reached

    def handle_event(self, event: Event) -> None:
        """Print an event."""
        self._time = event.time
        style = "bold red" if event.kind is EventKind.FAILURE else "dim"
        self._print(f"[{style}]{escape(event.text)}[/]")

    def handle_pause(self) -> None:
        """Draw the line, ten times a second at most."""
        record, now = self._latest, monotonic()
        if record is None or now - self._drawn < _REDRAW:
            return
        self._drawn = now
        mode = record.output.control_mode.mode
        self._line.draw(status_parts(record, self._frame, self._overruns, self._told, self._line.width), mode)

    def handle_close(self) -> None:
        """Take the line away."""
        self._line.clear()

    def _what_comes_next(self, record: TickRecord) -> str:
        if not self._told.has_keys:
            return ""
        found = [
            intent for intent in possible(record, self._told.available) if intent not in (Intent.DAMP, Intent.QUIT)
        ]
        return f": {', '.join(f'{key_of(intent)} {intent.name}' for intent in found)}" if found else ""

    def _print(self, text: str) -> None:
        self._line.clear()
        self._drawn = -math.inf
        self._console.print(f"[bold]{self._time:8.3f} s[/bold]  {text}", highlight=False)


def _is_reached(output: TickOutput) -> bool:
    return output.standby is not None and output.standby.is_finished


def _styled(mode: Mode | None) -> str:
    return "" if mode is None else f"[{MODE_STYLES[mode]}]{mode.name}[/]"
