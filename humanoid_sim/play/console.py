"""The operator's view of a run: every transition with its reason, every refusal, and a line of status."""

from __future__ import annotations

import math
import os
import select
import sys
from collections.abc import Callable, Container, Sequence
from time import monotonic

from rich.console import Console
from rich.markup import escape
from rich.style import Style

from humanoid_sim.cli import mute_output
from humanoid_sim.controllers.fsm import granted, merge_safety
from humanoid_sim.evaluation.run_report import MODE_STYLES
from humanoid_sim.messages import Event, EventKind, Intent, Mode, TickOutput, TickRecord
from humanoid_sim.mit import VELOCITY_COMMAND
from humanoid_sim.session.keyboard import REACTIVATE_KEY, key_of
from humanoid_sim.session.reactivation import HOW_TO_REACTIVATE, REACTIVABLE
from humanoid_sim.session.sinks import WorkerSink


class StatusLine:
    """Draws it in place, below whatever else was printed; on a terminal that takes nothing it is left out."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._is_wanted = console.is_terminal and not console.is_dumb_terminal
        self._shown = ""

    @property
    def width(self) -> int:
        """Columns that a line may have at present: the last one would make some terminals begin a new line."""
        try:
            columns = os.get_terminal_size(self._console.file.fileno()).columns
        except (OSError, ValueError):  # a file in memory
            columns = 0
        return max((columns or self._console.width) - 1, 10)

    def draw(self, parts: Sequence[str], mode: Mode) -> None:
        """Replace the line, whose first word is the mode."""
        line = "  ".join(parts)[: self.width]
        if not self._is_wanted or line == self._shown or not self._takes_more():
            return
        color = Style.parse(MODE_STYLES[mode]).color
        codes = ";".join(color.get_ansi_codes()) if color is not None and self._console.color_system else "1"
        name, rest = line[: len(mode.name)], line[len(mode.name) :]
        self._write(f"\r\x1b[2K\x1b[{codes}m{name}\x1b[0m{rest}")
        self._shown = line

    def clear(self) -> None:
        """Take the line away, so that something else can be printed where it was."""
        if self._shown:
            self._write("\r\x1b[2K")
            self._shown = ""

    def _takes_more(self) -> bool:
        """Return True if the terminal's output is not held (Ctrl-S) or far behind."""
        try:
            return bool(select.select([], [self._console.file.fileno()], [], 0.0)[1])
        except (OSError, ValueError):  # a file in memory
            return True

    def _write(self, text: str) -> None:
        self._console.file.write(text)
        self._console.file.flush()


_REDRAW = 0.1  # s between two drawings of the line, if nothing is printed between them


class PlayConsole(Console):
    """Standard output; a reader that leaves (`| head -1`) neither ends nor fails a run."""

    def __init__(self, *, quiet: bool = False) -> None:
        # The channel `virtual:b` and the colon after its name are no emoji.
        super().__init__(highlight=False, emoji=False, soft_wrap=not sys.stdout.isatty(), quiet=quiet)
        self.is_unread = False
        """Its reader has left."""

    def on_broken_pipe(self) -> None:
        """Print nowhere from here on."""
        self.is_unread = True
        mute_output()


class ConsoleSink(WorkerSink):
    """Prints transitions, refusals and events; keeps a line of status at the bottom where the output is a terminal."""

    def __init__(
        self,
        console: Console,
        *,
        has_keys: bool = False,
        walks: bool = False,
        motion_frames: int = 0,
        expected_duration: float | None = None,
        available: Container[str] = (),
        is_driven: Callable[[], bool] = lambda: True,
    ) -> None:
        """Take what the line needs beside ticks.

        Args:
            has_keys: an operator sits at the keys.
            walks: the policy takes a velocity command.
            motion_frames: frames of the policy's motion; 0 for none.
            expected_duration: s on the robot's clock, of the whole run; None if nobody can know.
            available: names of the controllers that exist.
            is_driven: True if commands reach the motors; they do not after a `reactivate` that failed.
        """
        super().__init__("console")
        self._console, self._line = console, StatusLine(console)
        self._has_keys, self._walks, self._motion_frames = has_keys, walks, motion_frames
        self._expected_duration, self._available, self._is_driven = expected_duration, available, is_driven
        self._mode: Mode | None = None
        self._controller = self._status = ""
        self._is_reached = False
        self._time = 0.0
        self._drawn = -math.inf
        # Written by the control thread, read by the worker's.
        self._queued: tuple[str, str, bool] = ("", "", False)
        self._latest: TickRecord | None = None
        self._frame: int | None = None
        self._overruns = 0

    @property
    def backlog(self) -> int:
        """0: a terminal that takes nothing holds no run up."""
        return 0

    def tick(self, record: TickRecord) -> None:
        """Queue a tick that has something to print; of the others only the latest is needed, for the line."""
        output = record.output
        self._latest = record
        self._overruns += record.overrun
        if output.policy_step is not None:
            self._frame = output.policy_step.frame
        shown = (output.control_mode.controller_name, output.control_mode.status_message, _is_reached(output))
        is_new, self._queued = shown != self._queued, shown
        if is_new or output.faults or output.refusals or record.input.intents:
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
        elif Intent.DAMP in record.input.intents and not self._is_driven():
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
        was_reached, self._is_reached = self._is_reached, _is_reached(output)
        if self._is_reached and not was_reached:
            self._print("standby reached")

    def handle_event(self, event: Event) -> None:
        """Print an event."""
        self._time = event.time
        style = "bold red" if event.kind is EventKind.FAILURE else "dim"
        self._print(f"[{style}]{escape(event.text)}[/]")

    def handle_pause(self) -> None:
        """Draw the line, ten times a second at most."""
        record, now = self._latest, monotonic()
        if record is not None and now - self._drawn >= _REDRAW:
            self._drawn = now
            self._line.draw(self._parts(record), record.output.control_mode.mode)

    def handle_close(self) -> None:
        """Take the line away."""
        self._line.clear()

    def _parts(self, record: TickRecord) -> list[str]:
        """Return the parts of the line that fit, the most important ones first: mode, keys, velocity, misses, time."""
        mode, time = record.output.control_mode.mode, float(record.input.state.time)
        parts = [f"{mode.name} {self._progress(record)}".strip()]
        velocity = record.input.state.extern.get(VELOCITY_COMMAND)
        shown = []
        if self._walks and velocity is not None:
            shown.append("v " + " ".join(f"{value:.2f}" for value in velocity.value))
        shown.append(f"{self._overruns} late tick{'' if self._overruns == 1 else 's'}")
        width = self._line.width
        parts += self._keys(record, width - sum(len(part) + 2 for part in (*parts, *shown))) + shown
        if self._expected_duration:
            parts.append(f"{min(100.0 * time / self._expected_duration, 100.0):.0f} %")
        parts.append(f"{time:.1f} s")
        while len(parts) > 1 and len("  ".join(parts)) > width:
            parts.pop()
        return parts

    def _progress(self, record: TickRecord) -> str:
        standby, frames = record.output.standby, self._motion_frames
        if standby is not None:
            percent = 100.0 * (standby.current_segment + standby.progress) / standby.total_segments
            return "reached" if standby.is_finished else f"{percent:.0f} %"
        is_driven = record.output.control_mode.mode is Mode.LOCOMOTION and self._frame is not None and frames
        return f"{100.0 * min((self._frame or 0) + 1, frames) / frames:.0f} %" if is_driven else ""

    def _keys(self, record: TickRecord, room: int) -> list[str]:
        """Return the present intents with their keys; the keys alone where the names do not fit."""
        if not self._has_keys:
            return []
        control = record.output.control_mode
        safety = merge_safety(record.input.safety)
        intents = granted(control.controller_name, safety, _is_reached(record.output), self._available)
        keys = [(key_of(one), one.name) for one in intents if one is not Intent.DAMP or self._is_driven()]
        if control.mode in REACTIVABLE:
            keys.append((REACTIVATE_KEY, "reactivate"))
        if self._walks and control.mode is Mode.LOCOMOTION:
            keys.append(("arrows", "velocity"))
        keys.append(("?", "help"))
        named = [f"{key} {name}" for key, name in keys]
        if len("  ".join(named)) + 2 <= room:
            return named
        return ["keys " + " ".join(key for key, _ in keys)]

    def _print(self, text: str) -> None:
        self._line.clear()
        self._drawn = -math.inf
        self._console.print(f"[bold]{self._time:8.3f} s[/bold]  {text}", highlight=False)


def _is_reached(output: TickOutput) -> bool:
    return output.standby is not None and output.standby.is_finished


def _styled(mode: Mode | None) -> str:
    return "" if mode is None else f"[{MODE_STYLES[mode]}]{mode.name}[/]"
