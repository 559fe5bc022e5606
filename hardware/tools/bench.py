"""What the tools share: open channels, answers of motors, limp motors, confirmations and tables."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TypeVar

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from humanoid_sim.cli import complain
from humanoid_sim.errors import HumanoidSimError, InputError, RobotError
from humanoid_sim.hardware.can_bus import BusAddress, OpenChannels
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.motor_link import LinkTerms, Motor, MotorLink
from humanoid_sim.hardware.robot import LINKS
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.protocol import LARGEST_MOTOR_ID
from humanoid_sim.robots.motors import MOTORS

EVERY_ID = range(1, LARGEST_MOTOR_ID + 1)
_HINTS = {  # by interface, where nothing at all is received
    "slcan": "does the adapter speak SLCAN? the vendor's own speaks AT frames, which nothing here does",
    "virtual": "its motors are those of one process; other processes reach those of `emulate` by udp_multicast",
}
Answer = TypeVar("Answer")


class SilentMotorError(HumanoidSimError):
    """A motor does not answer: the tool ends with a status of its own."""


@contextlib.contextmanager
def open_bench(addresses: Sequence[BusAddress], motors: Sequence[Motor] = ()) -> Iterator[RobstrideLink]:
    """Open channels for this tool alone, for some motors, or for every id that a motor may have, in order.

    Raises `RobotError` if a channel is in use, or cannot be opened.
    """
    scale = MOTORS["rs-00"]  # of the values of statuses, which are not shown
    every = [
        Motor(f"motor {motor_id} on {address}", channel, motor_id, scale)
        for channel, address in enumerate(addresses)
        for motor_id in EVERY_ID
    ]
    with contextlib.closing(OpenChannels(addresses, CheckList())) as line:
        link = RobstrideLink(line, motors or every)
        line.listeners.append(link.receive)
        yield link


def check_id(what: str, motor_id: int) -> None:
    """Refuse, by `InputError`, an id that no motor can have."""
    if motor_id not in EVERY_ID:
        raise InputError(f"{what}: is {motor_id}, expected 1 to {LARGEST_MOTOR_ID}")


def check_channels(link: RobstrideLink) -> None:
    """Raise `RobotError` if a channel is down, or another master speaks to these motors."""
    checks = CheckList()
    link.line.check(checks)
    checks.refuse()


def silence(link: RobstrideLink, channel: int, text: str) -> SilentMotorError:
    """Return the error for a channel on which `no motor answers`, with what was received there instead."""
    bus = link.line.channels[channel]
    troubles = "; ".join(bus.troubles()) or _HINTS.get(bus.address.interface, "")
    return SilentMotorError(f"{text} on {link.sources[channel]}{f' ({troubles})' if troubles else ''}")


def warn_of_troubles(link: RobstrideLink, channel: int) -> None:
    """Tell what was received on a channel beside the answers: another host's frames, bus errors."""
    for trouble in link.line.channels[channel].troubles():
        complain(f"warning: {link.sources[channel]}: {trouble}")


def answer_of(link: RobstrideLink, motor: int, answers: Mapping[int, Answer]) -> Answer:
    """Return a motor's answer; raises `SilentMotorError` where there is none."""
    if motor not in answers:
        trouble = link.slots[motor].invalid.text
        text = f"motor {link.motors[motor].motor_id} {f'cannot be read: {trouble}' if trouble else 'does not answer'}"
        raise silence(link, link.motors[motor].channel, text)
    return answers[motor]


@contextlib.contextmanager
def limp_motors(bench: RobstrideLink, motors: Sequence[Motor], terms: LinkTerms) -> Iterator[MotorLink]:
    """Enable some motors of one family, limp, after all checks of a session; disable them at the end, and verify it."""
    link = LINKS[motors[0].model.family](bench.line, motors, terms)
    bench.line.listeners[:] = [lambda *frame: any([link.receive(*frame), bench.receive(*frame)])]
    checks = CheckList()
    link.examine(checks)
    checks.refuse()
    try:
        link.make_ready(checks)
        bench.line.check(checks)
        checks.refuse()
        for warning in checks.of("warning"):
            complain(f"warning: {warning}")
        link.enable(checks)
        bench.line.check(checks)
        checks.refuse()
        yield link
    finally:
        left = link.stop(range(len(motors)))
        link.close()
        if left:
            names = ", ".join(f"{motors[i].name} ({state})" for i, state in left.items())
            raise RobotError(f"{names}: not confirmed to be disabled: switch the power off")


def confirm(question: str, yes: bool, otherwise: str) -> None:
    """Go on only if an operator types yes; an `InputError` says `otherwise`, such as `not moved`."""
    if not yes and not sys.stdin.isatty():
        raise InputError("--yes: is needed where standard input is not a terminal")
    if not (yes or answers_yes(question)):
        raise InputError(f"{otherwise}: not confirmed")


def answers_yes(question: str) -> bool:
    """Return whether an operator types yes."""
    try:
        return input(f"{question} Type yes: ").strip().lower() == "yes"
    except EOFError:
        return False


def make_console() -> Console:
    """Return standard output; `:b:` in a channel's name is no emoji, and a file has no line's end."""
    return Console(highlight=False, emoji=False, width=None if sys.stdout.isatty() else 200)


def make_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """Return a table of these rows."""
    table = Table(*headings, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for row in rows:
        table.add_row(*map(escape, row))
    return table
