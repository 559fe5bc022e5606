"""What the tools share: open channels, questions to one motor, confirmations and tables."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence

from rich import box
from rich.console import Console
from rich.table import Table

from humanoid_sim.cli import complain
from humanoid_sim.errors import HumanoidSimError, InputError, RobotError
from humanoid_sim.hardware.bus.address import BusAddress, open_bus, parse_address
from humanoid_sim.hardware.bus.channel import OpenBus
from humanoid_sim.hardware.bus.open_channels import Locks, OpenChannels
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.motor_link import LinkTerms, MotorGroup, MotorLink
from humanoid_sim.hardware.robot import LINKS
from humanoid_sim.hardware.robstride.codec import LARGEST_MOTOR_ID
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.messages import Command, DeviceId, GetDeviceId
from humanoid_sim.hardware.robstride.parameters import CanTimeout, Parameter
from humanoid_sim.robots.motors import MOTORS, MotorModel

_ANY_MODEL = MOTORS["rs-00"]
"""Model of motors that are not known: it scales only the values of statuses, which are then not shown."""


class SilentMotorError(HumanoidSimError):
    """A motor does not answer: the tool ends with a status of its own."""


def some_motors(
    places: Sequence[tuple[int, int]], sources: Sequence[str], model: MotorModel = _ANY_MODEL
) -> MotorGroup:
    """Return motors that no robot description names, by their channels' indices and ids."""
    zeros = (0.0,) * len(places)
    return MotorGroup(
        names=tuple(f"motor {motor_id} on {sources[channel]}" for channel, motor_id in places),
        channel=tuple(channel for channel, _ in places),
        motor_id=tuple(motor_id for _, motor_id in places),
        model=(model,) * len(places),
        torque_limit=zeros,
        current_limit=zeros,
    )


@contextlib.contextmanager
def open_bench(
    addresses: Sequence[BusAddress], host_id: int, motors: MotorGroup, open_channel: OpenBus = open_bus
) -> Iterator[RobstrideLink]:
    """Open channels for this tool alone. Raises `RobotError` if one is in use, or cannot be opened."""
    if not 0 <= host_id <= 0xFF:
        raise InputError(f"--host-id: is {host_id}, expected 0 to 255")
    checks, locks = CheckList(), Locks()
    try:
        locks.take(addresses, checks)
        line = OpenChannels(addresses, checks, open_bus=open_channel, locks=locks.descriptors)
        try:
            link = RobstrideLink(line, motors, host_id)
            line.listeners.append(link.receive)
            yield link
        finally:
            line.close()
    finally:
        locks.release()


@contextlib.contextmanager
def open_motor(channel: str, motor_id: int, host_id: int) -> Iterator[RobstrideLink]:
    """Open the channel of one motor, of any model."""
    if not 1 <= motor_id <= LARGEST_MOTOR_ID:
        raise InputError(f"motor id: is {motor_id}, expected 1 to {LARGEST_MOTOR_ID}")
    address = parse_address(channel)
    with open_bench([address], host_id, some_motors([(0, motor_id)], [str(address)])) as link:
        yield link


@contextlib.contextmanager
def enabled(
    bench: RobstrideLink, motors: MotorGroup, terms: LinkTerms, accepted_firmware: Collection[str] = ()
) -> Iterator[MotorLink]:
    """Enable some motors of one family, limp, after all checks of a session; disable them at the end, and verify it."""
    link = LINKS[motors.model[0].family](bench.line, motors, terms)
    bench.line.listeners[:] = [lambda *frame: any([link.receive(*frame), bench.receive(*frame)])]
    checks = CheckList(accepted=accepted_firmware)
    link.examine(checks)
    checks.refuse()
    checks.refuse_questions()
    try:
        link.make_ready(checks)
        bench.line.check(checks)
        checks.refuse()
        for warning in checks.warnings:
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


def require_up(link: RobstrideLink) -> None:
    """Raise `RobotError` if a channel is down."""
    for source, channel in zip(link.sources, link.channels, strict=True):
        if channel.down:
            raise RobotError(f"{source}: {channel.down}")


def silence(link: RobstrideLink, channel: int, text: str) -> HumanoidSimError:
    """Return the error for a channel on which `no motor answers`, or one does not, with what may explain it."""
    source = link.sources[channel]
    if link.channels[channel].down:
        return RobotError(f"{source}: {link.channels[channel].down}")
    hints = [*link.line.troubles(channel), _advice(link.channels[channel].address)]
    return SilentMotorError(f"{text} on {source} ({'; '.join(hints)})")


def _advice(address: BusAddress) -> str:
    match address.interface:
        case "virtual":
            return "a virtual channel exists in one program only; emulate motors on udp_multicast:239.74.163.2"
        case "udp_multicast":
            return f"python -m humanoid_sim.hardware emulate --channel {address}"
        case "slcan":
            return "does the adapter speak SLCAN? The vendor's USB adapter speaks AT frames"
        case _:
            return "check supply, plugs, terminators (60 Ω between CAN high and low), and 1 Mbit/s"


def ask_uid(link: RobstrideLink, motor: int = 0) -> bytes:
    """Return a motor's unique id."""
    question = GetDeviceId(link.motors.motor_id[motor], host_id=link.host_id)
    found = link.ask({motor: [question]}, lambda _, reply: reply.uid if isinstance(reply, DeviceId) else None)
    if motor not in found:
        raise _silent(link, motor)
    return found[motor]


def command_motor(link: RobstrideLink, command: Command) -> None:
    """Send a command that is answered by a status to the only motor."""
    if not link.until_status({0: [command]}, lambda _: True):
        raise _silent(link, 0)


def read_value(link: RobstrideLink, parameter: Parameter, motor: int = 0) -> float | None:
    """Return a parameter's value; None if the motor has no such parameter."""
    return _known(link, motor, link.read({motor: parameter}))


def write_value(link: RobstrideLink, parameter: Parameter, value: float, motor: int = 0) -> None:
    """Write a parameter and verify it."""
    found = _known(link, motor, link.write(parameter, {motor: value}))
    if found is None or not parameter.is_same(found, value):
        reads = "nothing" if found is None else f"{found:g}"
        raise RobotError(f"{link.motors.names[motor]}: {parameter.name} reads {reads} after {value:g} was written")


def _known(link: RobstrideLink, motor: int, found: Mapping[int, float | None]) -> float | None:
    if motor not in found:
        raise _silent(link, motor)
    return found[motor]


def _silent(link: RobstrideLink, motor: int) -> HumanoidSimError:
    return silence(link, link.motors.channel[motor], f"motor {link.motors.motor_id[motor]} does not answer")


def shown(parameter: Parameter, value: float | None) -> str:
    """Return a value for a person."""
    if value is None:
        return "not there"
    if parameter.name == "canTimeout":
        return f"{int(value)} ({1000.0 * CanTimeout.to_seconds(int(value)):g} ms)" if value else "0 (off)"
    return f"{value:g} {parameter.unit}".rstrip() if parameter.type.is_float else str(int(value))


def confirm(question: str, yes: bool, otherwise: str) -> None:
    """Go on only if an operator types yes; an `InputError` says `otherwise`, such as `not moved`."""
    if yes:
        return
    if not sys.stdin.isatty():
        raise InputError("--yes: is needed where standard input is not a terminal")
    if answer(question) != "yes":
        raise InputError(f"{otherwise}: not confirmed")


def answer(question: str) -> str:
    """Return what an operator types, in lower case."""
    try:
        return input(f"{question} Type yes: ").strip().lower()
    except EOFError:
        return ""


def make_console() -> Console:
    """Return standard output; `:b:` in a channel's name is no emoji, and a file has no line's end."""
    console = Console(highlight=False, emoji=False)
    return console if console.is_terminal else Console(highlight=False, emoji=False, width=200)


def make_table(*headings: str, right: Sequence[str] = ()) -> Table:
    """Return a table with these columns, of which those in `right` hold numbers."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for heading in headings:
        table.add_column(heading, justify="right" if heading in right else "left", overflow="fold")
    return table
