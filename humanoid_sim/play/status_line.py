"""The line at the bottom of an operator's terminal: what is, and what is possible now with which key."""

from __future__ import annotations

import os
import select
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.style import Style

from humanoid_sim.controllers.fsm import granted, merge_safety
from humanoid_sim.messages import Intent, Mode, StandbyState, TickRecord
from humanoid_sim.mit import VELOCITY_COMMAND
from humanoid_sim.session.keyboard import REACTIVATE_KEY, key_of
from humanoid_sim.session.reactivation import REACTIVABLE

MODE_STYLES = {
    Mode.ZERO_TORQUE: "bright_black",
    Mode.DAMPING: "yellow",
    Mode.STANDBY: "cyan",
    Mode.LOCOMOTION: "green",
    Mode.REMOTE: "magenta",
}


@dataclass(frozen=True, slots=True)
class Told:
    """What the line needs beside a tick."""

    has_keys: bool = False
    """An operator sits at the keys."""
    is_driven: Callable[[], bool] = lambda: True
    """Whether commands reach the motors; they do not after a `reactivate` that failed."""
    available: Container[str] = ()
    """Names of the controllers that exist."""
    walks: bool = False
    """The policy takes a velocity command."""
    motion_frames: int = 0
    """Of the policy's motion; 0 for none."""
    expected_duration: float | None = None
    """s on the robot's clock, of the whole run; None if nobody can know."""


def possible(record: TickRecord, available: Container[str]) -> tuple[Intent, ...]:
    """Return the intents that would be granted after a tick."""
    output = record.output
    is_finished = output.standby is not None and output.standby.is_finished
    return granted(output.control_mode.controller_name, merge_safety(record.input.safety), is_finished, available)


def status_parts(record: TickRecord, frame: int | None, overruns: int, told: Told, width: int) -> list[str]:
    """Return the parts of the line, the mode first; as many as fit into `width` columns, the most important ones first.

    Args:
        record: the latest tick.
        frame: of the motion, as of the latest policy step; None for none.
        overruns: deadlines missed so far.
        told: what does not change.
        width: in characters.
    """
    mode = record.output.control_mode.mode
    progress = _progress(record.output.standby, frame if mode is Mode.LOCOMOTION else None, told.motion_frames)
    time = float(record.input.state.time)
    parts = [mode.name + (f" {progress}" if progress else "")]
    velocity = record.input.state.extern.get(VELOCITY_COMMAND)
    shown = []
    if told.walks and velocity is not None:
        shown.append("v " + " ".join(f"{value:.2f}" for value in velocity.value))
    shown.append(f"{overruns} late tick{'' if overruns == 1 else 's'}")
    keys = _keys(record, told, width - sum(len(part) + 2 for part in (*parts, *shown)))
    parts += keys + shown
    if told.expected_duration:
        parts.append(f"{min(100.0 * time / told.expected_duration, 100.0):.0f} %")
    parts.append(f"{time:.1f} s")
    while len(parts) > 1 and len("  ".join(parts)) > width:
        parts.pop()
    return parts


def _progress(standby: StandbyState | None, frame: int | None, frames: int) -> str:
    if standby is not None:
        if standby.is_finished:
            return "reached"
        return f"{100.0 * (standby.current_segment + standby.progress) / standby.total_segments:.0f} %"
    return f"{100.0 * min(frame + 1, frames) / frames:.0f} %" if frame is not None and frames else ""


def _keys(record: TickRecord, told: Told, room: int) -> list[str]:
    """Return what is possible now with its key; the keys alone where there is no room for the names."""
    if not told.has_keys:
        return []
    intents = [i for i in possible(record, told.available) if i is not Intent.DAMP or told.is_driven()]
    asked = [(key_of(intent), intent.name) for intent in intents]
    if record.output.control_mode.mode in REACTIVABLE:
        asked.append((REACTIVATE_KEY, "reactivate"))
    if told.walks and record.output.control_mode.mode is Mode.LOCOMOTION:
        asked.append(("arrows", "velocity"))
    named = [f"{key} {name}" for key, name in asked]
    for keys in ([*named, "? help"], named):
        if len("  ".join(keys)) + 2 <= room:
            return keys
    return ["keys " + " ".join(key for key, _ in [*asked, ("?", "help")])]


class StatusLine:
    """Draws it in place, after whatever else was printed; on a terminal that takes nothing it is left out."""

    def __init__(self, console: Console) -> None:
        """Draw on the console's terminal; on no terminal nothing is drawn."""
        self._console = console
        self._is_dumb = console.is_dumb_terminal
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
        """Replace the line."""
        if not self._console.is_terminal:
            return
        line = "  ".join(parts)[: self.width]
        if line == self._shown or not self._takes_more():
            return
        if self._is_dumb:
            self._write("\r" + line.ljust(len(self._shown)))
        else:
            color = Style.parse(MODE_STYLES[mode]).color
            codes = ";".join(color.get_ansi_codes()) if color is not None and self._console.color_system else "1"
            name, rest = line[: len(mode.name)], line[len(mode.name) :]
            self._write(f"\r\x1b[2K\x1b[{codes}m{name}\x1b[0m{rest}")
        self._shown = line

    def clear(self) -> None:
        """Take the line away, so that something else can be printed where it was."""
        if self._shown:
            self._write("\r" + " " * len(self._shown) + "\r" if self._is_dumb else "\r\x1b[2K")
            self._shown = ""

    def _takes_more(self) -> bool:
        """Return whether the terminal's output is not held (Ctrl-S) or far behind."""
        try:
            return bool(select.select([], [self._console.file.fileno()], [], 0.0)[1])
        except (OSError, ValueError):  # a file in memory
            return True

    def _write(self, text: str) -> None:
        self._console.file.write(text)
        self._console.file.flush()
