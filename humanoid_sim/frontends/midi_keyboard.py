"""A MIDI keyboard that may be unplugged and come back: which keys are down, as long as that is known."""

from __future__ import annotations

import contextlib
from time import monotonic
from typing import Any

import mido
import numpy as np

from humanoid_sim.errors import InputError, blaming, needing
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.song import PERCUSSION
from humanoid_sim.robots.piano import FIRST_NOTE, KEY_COUNT

_CHECK_PERIOD = 0.5  # s between two checks that the port is there: no library reports when it goes
_OWN_PORTS = "Midi Through"  # of ALSA itself, which are not keyboards
_ALL_OFF = (120, 123)  # controllers: all sound off, all notes off


def port_names() -> list[str]:
    """Return the ports that a keyboard may be at. Raises `InputError` where there is no sequencer."""
    with needing("rtmidi", "midi", "a MIDI keyboard"):
        import rtmidi  # noqa: F401, PLC0415 - an extra, which mido uses
    with blaming("--port: no MIDI sequencer", Exception):
        return [name for name in mido.get_input_names() if not name.startswith(_OWN_PORTS)]


class Keyboard:
    """The keys that are down: a key is down as long as some channel holds it, whatever the pedal does."""

    def __init__(self, part: str) -> None:
        """Open the first port whose name has this part; '' for any. Raises `InputError` if there is none."""
        self._part, self._checked = part, 0.0
        self._port: Any = None  # mido's; None while the keyboard is gone
        self._held: set[tuple[int, int]] = set()  # channel and key
        self._open()

    @property
    def is_known(self) -> bool:
        """True while it is known which keys are down."""
        return self._port is not None

    @property
    def pressed(self) -> FloatArray:
        """Shape (88,): 1 for each key that is down, else 0, A0 first; none of a keyboard that is gone."""
        values = np.zeros(KEY_COUNT)
        values[[key for _, key in self._held]] = 1.0
        return values

    def close(self) -> None:
        if self._port is not None:
            self._port.close()
            self._port = None

    def poll(self) -> list[str]:
        """Read what has come; a line for an operator where the keyboard goes or comes back."""
        lines = []
        if monotonic() - self._checked > _CHECK_PERIOD:
            self._checked = monotonic()
            if self._port is None:
                with contextlib.suppress(InputError):
                    self._open()
                    lines.append("the keyboard is there again")
            elif self.name not in port_names():
                self.close()
                self._held.clear()
                lines.append("the keyboard is gone: all keys released")
        for message in () if self._port is None else self._port.iter_pending():
            self._take(message)
        return lines

    def _open(self) -> None:
        names = port_names()
        found = [name for name in names if self._part.lower() in name.lower()]
        if not found:
            raise InputError(f"--port: no keyboard with '{self._part}'; ports: {', '.join(names) or 'none'}")
        self.name = found[0]
        self._port = mido.open_input(self.name)
        self._checked = monotonic()

    def _take(self, message: mido.Message) -> None:
        if message.type == "control_change" and message.control in _ALL_OFF:
            self._held = {held for held in self._held if held[0] != message.channel}
        elif message.type in ("note_on", "note_off") and message.channel != PERCUSSION:
            held = (message.channel, message.note - FIRST_NOTE)
            self._held.discard(held)
            if message.type == "note_on" and message.velocity > 0 and 0 <= held[1] < KEY_COUNT:
                self._held.add(held)
