"""`python -m humanoid_sim.midi`: sends to a running session which keys of a MIDI keyboard are down."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from time import monotonic

import mido
import numpy as np

from humanoid_sim.cli import parse, run_program
from humanoid_sim.client import Intake, monotonic_ns
from humanoid_sim.errors import InputError, blaming, needing
from humanoid_sim.frontends.attach import attached, run_steps
from humanoid_sim.mit import KEY_PRESSED, FloatArray
from humanoid_sim.policy.song import PERCUSSION
from humanoid_sim.robots.piano import FIRST_NOTE, KEY_COUNT

_LEAST_PERIOD = 0.002  # s between two samples; else half a control period
_CHECK_PERIOD = 0.5  # s between two checks that the port is there: no library reports when it goes
_OWN_PORTS = "Midi Through"  # of ALSA itself, which are not keyboards
_ALL_OFF = (120, 123)  # controllers: all sound off, all notes off


@dataclass(frozen=True)
class MidiConfig:
    """Send to a running session which keys of a MIDI keyboard are down, for a piano policy.

    Note on and off of all channels but the drums' count; the pedal does not keep a key down.
    """

    session: int | None = None
    """Process id of the session. Default: the only one that runs."""
    port: str = ""
    """Part of the name of the keyboard's MIDI port. Default: the first one."""


def port_names() -> list[str]:
    """Return the ports that a keyboard may be at. Raises `InputError` without a sequencer."""
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


class Sender:
    """Sends the keys in each period, changed or not: silence means a lost keyboard."""

    def __init__(self, intake: Intake, keyboard: Keyboard) -> None:
        self._intake, self._keyboard, self._polled = intake, keyboard, monotonic_ns()

    def step(self) -> list[str]:
        """Poll and send. Raises `SessionError` if the session has ended, `InputError` if the keyboard is gone."""
        stamp, self._polled = self._polled, monotonic_ns()  # what is found now came after the poll before
        self._keyboard.poll()
        self._intake.live(KEY_PRESSED, self._keyboard.pressed.tolist(), stamp=stamp)
        return []


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until the session ends; returns the exit status."""
    config = parse(MidiConfig, "midi", arguments)
    with closing(Keyboard(config.port)) as keyboard, attached(config.session, "midi") as attachment:
        width = attachment.live_inputs.get(KEY_PRESSED, 0)
        if width != KEY_COUNT:
            raise InputError(f"{attachment}: takes {width} keys from outside, expected {KEY_COUNT}")
        print(f"the keys of {keyboard.name}, for {attachment}", flush=True)
        period = max(0.5 * attachment.header.control_period, _LEAST_PERIOD)
        run_steps(attachment, Sender(attachment.intake, keyboard).step, period)
    return 0


if __name__ == "__main__":
    sys.exit(run_program(main))
