"""A MIDI keyboard: which keys are down, until it is unplugged."""

from __future__ import annotations

from time import monotonic

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
        names = port_names()
        found = [name for name in names if part.lower() in name.lower()]
        if not found:
            raise InputError(f"--port: no keyboard with '{part}'; ports: {', '.join(names) or 'none'}")
        self.name = found[0]
        self._port, self._checked = mido.open_input(self.name), monotonic()
        self._held: set[tuple[int, int]] = set()  # channel and key

    @property
    def pressed(self) -> FloatArray:
        """Shape (88,): 1 for each key that is down, else 0, A0 first."""
        values = np.zeros(KEY_COUNT)
        values[[key for _, key in self._held]] = 1.0
        return values

    def close(self) -> None:
        self._port.close()

    def poll(self) -> None:
        """Read what has come. Raises `InputError` if the keyboard is gone."""
        if monotonic() - self._checked > _CHECK_PERIOD:
            self._checked = monotonic()
            if self.name not in port_names():
                raise InputError(f"{self.name}: is gone")
        for message in self._port.iter_pending():
            self._take(message)

    def _take(self, message: mido.Message) -> None:
        if message.type == "control_change" and message.control in _ALL_OFF:
            self._held = {held for held in self._held if held[0] != message.channel}
        elif message.type in ("note_on", "note_off") and message.channel != PERCUSSION:
            held = (message.channel, message.note - FIRST_NOTE)
            self._held.discard(held)
            if message.type == "note_on" and message.velocity > 0 and 0 <= held[1] < KEY_COUNT:
                self._held.add(held)
