"""`python -m humanoid_sim.midi`: tells a running session which keys of a MIDI keyboard are down."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial

from humanoid_sim.cli import parse, run_program
from humanoid_sim.client import LIVE_TIMEOUT, Intake
from humanoid_sim.errors import InputError
from humanoid_sim.frontends import require_packages
from humanoid_sim.frontends.attach import Attachment, attached, ready, steps
from humanoid_sim.frontends.midi.device import STANDARD_INPUT, ByteDevice, Port, Source, port_names
from humanoid_sim.frontends.midi.keyboard import Keyboard
from humanoid_sim.mit import KEY_PRESSED
from humanoid_sim.robots.piano import KEY_COUNT

_LEAST_PERIOD = 0.005
"""s between two samples; else half a control period."""


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
    """A raw MIDI byte stream instead of a port: a device such as /dev/snd/midiC1D0, a serial line, a FIFO, or - for
    standard input."""
    baud: int = 31250
    """Bits a second of a serial line. Default: that of MIDI cables."""
    transpose: int = 0
    """Semitones to add to every note: 12 for a keyboard whose keys are an octave below the piano's."""
    list: bool = False
    """Show the MIDI ports and end; 1 if there is none."""


class Teller:
    """From the keyboard to the session's intake: a sample in each period, as long as it is known which keys are down.

    When that is lost, one last sample has all keys released; then the session finds that no more come.
    """

    def __init__(self, intake: Intake, keyboard: Keyboard) -> None:
        self._intake, self._keyboard = intake, keyboard
        self._was_known = True

    def step(self, seconds: float) -> list[str]:
        """Listen for so long, and tell; lines for an operator.

        Raises:
            SessionError: the session has ended.
            InputError: the keyboard cannot be read.
        """
        lines = self._keyboard.look(seconds)
        is_known = self._keyboard.is_known
        if is_known or self._was_known:
            keys = self._keyboard.pressed.tolist()
            # Repeated all the time, so silence means a lost keyboard, whatever the policy's contract allows.
            self._intake.live(KEY_PRESSED, keys, timeout=LIVE_TIMEOUT, stamp=self._keyboard.stamp)
        self._was_known = is_known
        return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until the session ends; returns the exit status."""
    config = parse(MidiConfig, "midi", arguments)
    _check(config)
    if not config.device:
        require_packages("midi")
    if config.list:
        return _list()
    with ExitStack() as stack:
        source = _opened(config)
        keyboard = Keyboard(source, partial(_again, config), transpose=config.transpose)
        stack.callback(keyboard.close)
        attachment = stack.enter_context(attached(config.session, "midi"))
        _check_session(attachment)
        ready(f"the keys of {source.name}, for {attachment.session}")
        teller = Teller(attachment.intake, keyboard)
        period = max(0.5 * attachment.feed.control_period, _LEAST_PERIOD)
        for lines in steps(attachment, lambda: teller.step(period)):
            if config.device == STANDARD_INPUT and lines and not keyboard.is_known:
                return 1  # it cannot come back
    return 0


def _check(config: MidiConfig) -> None:
    if config.port and config.device:
        raise InputError("--port and --device: expected at most one of them")
    if abs(config.transpose) >= KEY_COUNT:
        raise InputError(f"--transpose: is {config.transpose} semitones, expected {1 - KEY_COUNT} to {KEY_COUNT - 1}")
    if not 50 <= config.baud <= 4_000_000:
        raise InputError(f"--baud: is {config.baud}, expected 50 to 4000000")


def _check_session(attachment: Attachment) -> None:
    """Refuse a session that takes no keys, or another number of them."""
    width = attachment.feed.live_inputs.get(KEY_PRESSED)
    if width is None:
        contract = attachment.contract
        is_piano = contract is not None and contract.task_type == "piano"
        why = "its robot has a piano whose keys it knows" if is_piano else "its policy plays no piano"
        raise InputError(f"{attachment.session}: takes no keys from outside: {why}")
    if width != KEY_COUNT:
        raise InputError(f"{attachment.session}: its policy's piano has {width} keys, expected {KEY_COUNT}")


def _opened(config: MidiConfig) -> Source:
    """Return the keyboard. Raises `InputError` if it is not there."""
    try:
        return _open(config)
    except ConnectionError:
        if config.device:
            raise InputError(f"--device: {config.device}: nobody is at its other end, expected a keyboard") from None
        listed = ", ".join(port_names()) or "none"
        what = f"has '{config.port}' in its name" if config.port else "is plugged in"
        raise InputError(f"--port: no keyboard {what}; ports: {listed}") from None


def _open(config: MidiConfig) -> Source:
    return ByteDevice(config.device, config.baud) if config.device else Port(config.port)


def _again(config: MidiConfig) -> Source | None:
    """Return the keyboard once it has come back."""
    try:
        return _open(config)
    except (ConnectionError, InputError):  # a device that is unplugged has no name in the file system either
        return None


def _list() -> int:
    names = port_names()
    for name in names:
        print(name)
    if not names:
        print("no MIDI keyboard is plugged in")
    return 0 if names else 1


if __name__ == "__main__":
    sys.exit(run_program(main))
