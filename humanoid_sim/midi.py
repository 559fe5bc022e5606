"""`python -m humanoid_sim.midi`: sends to a running session which keys of a MIDI keyboard are down."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from time import sleep

from humanoid_sim.cli import parse, run_program
from humanoid_sim.client import LIVE_TIMEOUT, Intake, monotonic_ns
from humanoid_sim.errors import InputError
from humanoid_sim.frontends import require_packages
from humanoid_sim.frontends.attach import Attachment, attached, ready, steps
from humanoid_sim.frontends.midi.keyboard import ByteDevice, Keyboard, Port, Source, port_names
from humanoid_sim.mit import KEY_PRESSED
from humanoid_sim.robots.piano import KEY_COUNT

_LEAST_PERIOD = 0.002  # s between two samples; else half a control period


@dataclass(frozen=True)
class MidiConfig:
    """Tell a running session which keys of a MIDI keyboard are down, for a piano policy.

    Note on and off of all channels but the drums' count; the pedal does not keep a key down.
    """

    session: int | None = None
    """Process id of the session. Default: the only one that runs."""
    port: str = ""
    """Part of the name of the keyboard's MIDI port. Default: the first one."""
    device: str = ""
    """A raw MIDI byte stream instead of a port: a device such as /dev/snd/midiC1D0, or a FIFO."""
    transpose: int = 0
    """Semitones to add to every note: 12 for a keyboard whose keys are an octave below the piano's."""
    list: bool = False
    """Show the MIDI ports and end; 1 if there is none."""

    def open(self) -> Source:
        """Open the keyboard. Raises `InputError`, or `ConnectionError` if it is not there."""
        return ByteDevice(self.device) if self.device else Port(self.port)


class Sender:
    """From the keyboard to the session: a sample in each period, as long as it is known which keys are down.

    When that is lost, one last sample has all keys released; then the session finds that no more come.
    """

    def __init__(self, intake: Intake, keyboard: Keyboard) -> None:
        self._intake, self._keyboard = intake, keyboard
        self._was_known, self._polled = True, monotonic_ns()

    def step(self) -> list[str]:
        """Poll and send; lines for an operator. Raises `SessionError` if the session has ended."""
        stamp, self._polled = self._polled, monotonic_ns()  # what is found now came after the poll before
        lines = self._keyboard.poll()
        is_known = self._keyboard.is_known
        if is_known or self._was_known:
            keys = self._keyboard.pressed.tolist()
            # Repeated all the time, so silence means a lost keyboard, whatever the policy's contract allows.
            self._intake.live(KEY_PRESSED, keys, timeout=LIVE_TIMEOUT, stamp=stamp)
        self._was_known = is_known
        return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until the session ends; returns the exit status."""
    config = parse(MidiConfig, "midi", arguments)
    if config.port and config.device:
        raise InputError("--port and --device: expected at most one of them")
    if abs(config.transpose) >= KEY_COUNT:
        raise InputError(f"--transpose: is {config.transpose} semitones, expected {1 - KEY_COUNT} to {KEY_COUNT - 1}")
    if not config.device:
        require_packages("midi")
    if config.list:
        names = port_names()
        print("\n".join(names) or "no MIDI keyboard is plugged in")
        return 0 if names else 1
    with ExitStack() as stack:
        try:
            source = config.open()
        except ConnectionError:
            where = f"--device: {config.device}: nobody is at its other end" if config.device else "--port: no keyboard"
            named = "" if config.device else f" with '{config.port}'; ports: {', '.join(port_names()) or 'none'}"
            raise InputError(f"{where}{named}") from None
        keyboard = Keyboard(source, config.open, config.transpose)
        stack.callback(keyboard.close)
        attachment = stack.enter_context(attached(config.session, "midi"))
        _check_session(attachment)
        ready(f"the keys of {source.name}, for {attachment}")
        sender = Sender(attachment.intake, keyboard)
        for _ in steps(attachment, sender.step):
            sleep(max(0.5 * attachment.header.control_period, _LEAST_PERIOD))
    return 0


def _check_session(attachment: Attachment) -> None:
    """Refuse a session that takes no keys, or another number of them."""
    width = attachment.live_inputs.get(KEY_PRESSED)
    if width is None:
        is_piano = attachment.contract is not None and attachment.contract.task_type == "piano"
        why = "its robot has a piano whose keys it knows" if is_piano else "its policy plays no piano"
        raise InputError(f"{attachment}: takes no keys from outside: {why}")
    if width != KEY_COUNT:
        raise InputError(f"{attachment}: its policy's piano has {width} keys, expected {KEY_COUNT}")


if __name__ == "__main__":
    sys.exit(run_program(main))
