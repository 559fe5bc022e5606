"""`python -m humanoid_sim.midi`: sends to a running session which keys of a MIDI keyboard are down."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass

from humanoid_sim.cli import parse, run_program
from humanoid_sim.client import Intake, monotonic_ns
from humanoid_sim.errors import InputError
from humanoid_sim.frontends.attach import attached, run_steps
from humanoid_sim.frontends.midi_keyboard import Keyboard
from humanoid_sim.mit import KEY_PRESSED
from humanoid_sim.robots.piano import KEY_COUNT

_LEAST_PERIOD = 0.002  # s between two samples; else half a control period


@dataclass(frozen=True)
class MidiConfig:
    """Send to a running session which keys of a MIDI keyboard are down, for a piano policy.

    Note on and off of all channels but the drums' count; the pedal does not keep a key down.
    """

    session: int | None = None
    """Process id of the session. Default: the only one that runs."""
    port: str = ""
    """Part of the name of the keyboard's MIDI port. Default: the first one."""


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
