"""What the tools share: open channels, questions to one motor, confirmations and tables."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterable, Iterator, Sequence

from rich import box
from rich.console import Console
from rich.table import Table

from humanoid_sim.cli import complain
from humanoid_sim.errors import HumanoidSimError, InputError, RobotError
from humanoid_sim.hardware.can_bus import BusAddress, OpenChannels, lock_channels, parse_address
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.motor_link import LinkTerms, MotorGroup, MotorLink
from humanoid_sim.hardware.robot import LINKS
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.parameters import CAN_TIMEOUT_TICK, Parameter
from humanoid_sim.hardware.robstride.protocol import LARGEST_MOTOR_ID, FrameType
from humanoid_sim.robots.motors import MOTORS


class SilentMotorError(HumanoidSimError):
    """A motor does not answer: the tool ends with a status of its own."""


def some_motors(places: Sequence[tuple[int, int]], sources: Sequence[str]) -> MotorGroup:
    """Return motors that no robot description names, by their channels' indices and ids."""
    zeros = (0.0,) * len(places)
    return MotorGroup(
        names=tuple(f"motor {motor_id} on {sources[channel]}" for channel, motor_id in places),
        channel=tuple(channel for channel, _ in places),
        motor_id=tuple(motor_id for _, motor_id in places),
        model=(MOTORS["rs-00"],) * len(places),  # scales the values of statuses, which are not shown
        torque_limit=zeros,
        current_limit=zeros,
    )


@contextlib.contextmanager
def open_bench(addresses: Sequence[BusAddress], motors: MotorGroup | None = None) -> Iterator[RobstrideLink]:
    """Open channels for this tool alone. Raises `RobotError` if one is in use, or cannot be opened."""
    checks = CheckList()
    with contextlib.ExitStack() as opened:
        locks = lock_channels(addresses, checks)
        for lock in locks:
            opened.callback(lock.close)
        line = OpenChannels(addresses, checks, locks=locks)
        opened.callback(line.close)
        link = RobstrideLink(line, motors or some_motors([], []))
        line.listeners.append(link.receive)
        yield link


@contextlib.contextmanager
def open_motor(channel: str, motor_id: int) -> Iterator[RobstrideLink]:
    """Open the channel of one motor, of any model."""
    if not 1 <= motor_id <= LARGEST_MOTOR_ID:
        raise InputError(f"motor id: is {motor_id}, expected 1 to {LARGEST_MOTOR_ID}")
    address = parse_address(channel)
    with open_bench([address], some_motors([(0, motor_id)], [str(address)])) as link:
        yield link


@contextlib.contextmanager
def enabled(bench: RobstrideLink, motors: MotorGroup, terms: LinkTerms) -> Iterator[MotorLink]:
    """Enable some motors of one family, limp, after all checks of a session; disable them at the end, and verify it."""
    link = LINKS[motors.model[0].family](bench.line, motors, terms)
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
        left = link.stop(range(motors.count))
        link.close()
        if left:
            names = ", ".join(f"{motors.names[i]} ({state})" for i, state in left.items())
            raise RobotError(f"{names}: not confirmed to be disabled: switch the power off")


def check_channels(link: RobstrideLink) -> None:
    """Raise `RobotError` if a channel is down, or another master speaks to these motors."""
    checks = CheckList()
    link.line.check(checks)
    checks.refuse()


def silence(link: RobstrideLink, channel: int, text: str) -> SilentMotorError:
    """Return the error for a channel on which `no motor answers`, with what was received there instead."""
    check_channels(link)
    troubles = "; ".join(link.line.channels[channel].troubles())
    return SilentMotorError(f"{text} on {link.sources[channel]}" + f" ({troubles})" * bool(troubles))


def _silent_motor(link: RobstrideLink, motor: int) -> SilentMotorError:
    return silence(link, link.motors.channel[motor], f"motor {link.motors.motor_id[motor]} does not answer")


def ask_uid(link: RobstrideLink, motor: int = 0) -> bytes:
    """Return a motor's unique id."""
    found = link.read_uids([motor])
    if motor not in found:
        raise _silent_motor(link, motor)
    return found[motor]


def command_motor(link: RobstrideLink, kind: FrameType, data: bytes) -> None:
    """Send a command that is answered by a status to the only motor."""
    if not link.until_status({0: [link.frame(0, kind, data)]}, lambda _: True):
        raise _silent_motor(link, 0)


def read_value(link: RobstrideLink, parameter: Parameter, motor: int = 0) -> float | None:
    """Return a parameter's value; None if the motor has no such parameter."""
    found = link.read({motor: parameter})
    if motor not in found:
        raise _silent_motor(link, motor)
    return found[motor]


def write_value(link: RobstrideLink, parameter: Parameter, value: float, motor: int = 0) -> None:
    """Write a parameter and verify it."""
    found = link.write(parameter, {motor: value}).get(motor)
    if found is None or not parameter.is_same(found, value):
        raise RobotError(f"{link.motors.names[motor]}: {parameter.name} reads {found} after {value:g} was written")


def shown(parameter: Parameter, value: float | None) -> str:
    """Return a value for a person."""
    if value is None:
        return "not there"
    if parameter.name == "canTimeout":
        return f"{int(value)} ({1000.0 * CAN_TIMEOUT_TICK * value:g} ms)" if value else "0 (off)"
    return f"{value:g} {parameter.unit}".rstrip() if parameter.is_float else str(int(value))


def confirm(question: str, yes: bool, otherwise: str) -> None:
    """Go on only if an operator types yes; an `InputError` says `otherwise`, such as `not moved`."""
    if yes:
        return
    if not sys.stdin.isatty():
        raise InputError("--yes: is needed where standard input is not a terminal")
    if not answers_yes(question):
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
        table.add_row(*row)
    return table
