"""What an operator sees while a run goes on: every transition with its reason, every refusal, and a progress bar."""

from __future__ import annotations

import contextlib
import os
import sys

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from humanoid_sim.cli import mute_output
from humanoid_sim.messages import Event, EventKind, Mode, SessionHeader, TickRecord
from humanoid_sim.session.sinks import WorkerSink

__all__ = ["MODE_STYLES", "ConsoleSink", "PlayConsole"]

MODE_STYLES = {
    Mode.ZERO_TORQUE: "bright_black",
    Mode.DAMPING: "yellow",
    Mode.STANDBY: "cyan",
    Mode.LOCOMOTION: "green",
    Mode.REMOTE: "magenta",
}


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
    """Prints transitions, refusals and events; draws the bar where the output is a terminal."""

    def __init__(self, console: Console, expected_duration: float | None) -> None:
        """Prepare.

        Args:
            console: where to print.
            expected_duration: s on the robot's clock, for the bar; None if nobody can know.
        """
        super().__init__("console", period=0.05)
        self._console = console
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=None),
            TaskProgressColumn(),
            TextColumn("{task.fields[clock]}"),
            TimeElapsedColumn(),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        self._task = self._progress.add_task("", total=expected_duration, clock="")
        self._mode: Mode | None = None
        self._controller = ""
        self._time = 0.0
        # Written by the control thread, read by the worker's.
        self._queued_status = ("", "")
        self._clock = 0.0

    def pause(self) -> None:
        """Show the cursor that the bar hides: the terminal is about to be another program's."""
        if self._console.is_terminal:
            with contextlib.suppress(OSError):
                os.write(self._console.file.fileno(), b"\x1b[?25h")

    def tick(self, record: TickRecord) -> None:
        """Queue a tick that has something to print; of the others only the time is needed, for the bar."""
        output = record.output
        self._clock = float(record.input.state.time)
        status = (output.control_mode.controller_name, output.control_mode.status_message)
        if status != self._queued_status or output.faults or output.refusals:
            self._queued_status = status
            super().tick(record)

    def event(self, event: Event) -> None:
        """Queue an event."""
        self._clock = event.time
        super().event(event)

    def handle_start(self, header: SessionHeader) -> None:
        """Show the bar."""
        self._progress.start()

    def handle_tick(self, record: TickRecord) -> None:
        """Print what is new in this tick."""
        control = record.output.control_mode
        self._time = float(record.input.state.time)
        if control.controller_name != self._controller:
            before = f"{_styled(self._mode)} → " if self._mode is not None else ""
            self._print(f"{before}{_styled(control.mode)}  [dim]{escape(control.status_message)}[/dim]")
            self._mode, self._controller = control.mode, control.controller_name
        else:
            faults = (f"{fault.controller} failed: {fault.message}" for fault in record.output.faults)
            bad = (*faults, *record.output.refusals)
            for text in bad:
                self._print(f"[red]{escape(text)}[/red]")
            if not bad:
                self._print(f"[dim]{escape(control.status_message)}[/dim]")

    def handle_event(self, event: Event) -> None:
        """Print an event."""
        self._time = event.time
        style = "bold red" if event.kind in (EventKind.FAILURE, EventKind.FALL) else "dim"
        self._print(f"[{style}]{escape(event.text)}[/]")

    def handle_pause(self) -> None:
        """Move the bar."""
        self._progress.update(
            self._task,
            completed=self._clock,
            description=_styled(self._mode) if self._mode is not None else "",
            clock=f"{self._clock:6.2f} s",
        )

    def handle_close(self) -> None:
        """Take the bar away."""
        self._progress.stop()

    def _print(self, text: str) -> None:
        self._console.print(f"[bold]{self._time:8.3f} s[/bold]  {text}", highlight=False)


def _styled(mode: Mode | None) -> str:
    return "" if mode is None else f"[{MODE_STYLES[mode]}]{mode.name}[/]"
