"""Motors on a bench: opening their channels, asking one, and what to say where none answers.

Whatever asks a motor raises `SilentMotorError` where it does not answer, and `RobotError` where its channel is down.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from humanoid_sim.cli import complain
from humanoid_sim.errors import HumanoidSimError, InputError, RobotError
from humanoid_sim.hardware.bus.address import BusAddress, open_bus, parse_address
from humanoid_sim.hardware.bus.channel import OpenBus
from humanoid_sim.hardware.bus.frame import BITRATE
from humanoid_sim.hardware.bus.open_channels import Locks, OpenChannels
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.motor_link import LinkTerms, MotorGroup
from humanoid_sim.hardware.robstride.codec import LARGEST_MOTOR_ID
from humanoid_sim.hardware.robstride.link import RobstrideLink, Unreadable
from humanoid_sim.hardware.robstride.messages import Command, DeviceId, GetDeviceId
from humanoid_sim.hardware.robstride.parameters import Parameter
from humanoid_sim.hardware.sito.motors import SitoMotors
from humanoid_sim.robots.motors import FAMILIES, MOTORS, MotorModel

_ANY_MODEL = MOTORS["rs-00"]
"""Model of motors that are not known: it scales only the values of statuses, which are then not shown."""
_EMULATED = frozenset({"virtual", "udp_multicast"})
"""Interfaces on which no real motor can be."""
LISTENING = 0.3
"""s in which a motor that sends feedback is heard: a Sito's comes every 255 ms at the latest."""
FEEDBACK_PERIOD = 0.02
"""s between two frames of feedback."""


class SilentMotorError(HumanoidSimError):
    """A motor does not answer: the tool ends with a status of its own."""


def some_motors(
    places: Sequence[tuple[int, int]], sources: Sequence[str], model: MotorModel = _ANY_MODEL
) -> MotorGroup:
    """Motors that no robot description names: by their channels' indices and ids."""
    count = len(places)
    return MotorGroup(
        names=tuple(f"motor {motor_id} on {sources[channel]}" for channel, motor_id in places),
        channel=tuple(channel for channel, _ in places),
        motor_id=tuple(motor_id for _, motor_id in places),
        model=(model,) * count,
        torque_limit=(0.0,) * count,
        current_limit=(0.0,) * count,
    )


@contextlib.contextmanager
def open_bench(
    addresses: Sequence[BusAddress], host_id: int, motors: MotorGroup, *, open_channel: OpenBus = open_bus
) -> Iterator[RobstrideLink]:
    """Provide channels for this tool alone, as a session has them.

    Raises:
        InputError: the host id is none.
        RobotError: a channel is in use by a session or another tool, or cannot be opened.
    """
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
def motor_bench(channel: str, motor_id: int, host_id: int) -> Iterator[RobstrideLink]:
    """Provide the channel of one motor, of whatever model, for tools that talk to one; errors are `open_bench`'s."""
    if not 1 <= motor_id <= LARGEST_MOTOR_ID:
        raise InputError(f"motor id: is {motor_id}, expected 1 to {LARGEST_MOTOR_ID}")
    address = parse_address(channel)
    with open_bench([address], host_id, some_motors([(0, motor_id)], [str(address)])) as channels:
        yield channels


def advice_for_silence(source: str) -> tuple[str, ...]:
    """Say what to check where nobody answers on a channel, one line each."""
    address = parse_address(source)
    if address.interface in _EMULATED:
        emulate = "python -m humanoid_sim.hardware emulate --channel"
        if address.interface == "virtual":
            between = "udp_multicast:239.74.163.2"
            return (
                f"check: a virtual channel exists inside one program only; two share {between} ({emulate} {between})",
            )
        return (f"check: does anybody emulate motors there? {emulate} {source}",)
    return (
        "check: is the motors' supply on?",
        "check: supply off, the resistance between CAN high and CAN low: 60 Ω; at 120 Ω a terminator is missing",
        "check: are CAN high and CAN low exchanged, or the plugs of two buses?",
        f"check: is the adapter set to {BITRATE} bit/s, as motors are when they come?",
        "check: were the motors switched to another protocol or bit rate? The vendor's tool finds them then",
    )


def require_up(channels: RobstrideLink) -> None:
    """Go no further on a channel that is down."""
    for source, channel in zip(channels.sources, channels.channels, strict=True):
        if channel.down:
            raise RobotError(f"{source}: {channel.down}")


def silence(channels: RobstrideLink, motor: int = 0, who: str = "") -> HumanoidSimError:
    """Return the error for a motor that does not answer, with what its channel says about why nothing comes back."""
    index = channels.motors.channel[motor]
    return _no_answer(channels, index, f"{who or f'motor {channels.motors.motor_id[motor]}'} does not answer")


def nobody(channels: RobstrideLink, index: int) -> HumanoidSimError:
    """Return the error for a channel on which no motor answers, after what to check was printed."""
    if not channels.channels[index].down:
        for line in advice_for_silence(channels.sources[index]):
            complain(line)
    return _no_answer(channels, index, "no motor answers")


def _no_answer(channels: RobstrideLink, index: int, what: str) -> HumanoidSimError:
    source, troubles = channels.sources[index], channels.line.troubles(index)
    if channels.channels[index].down:
        return RobotError(f"{source}: {troubles[0]}")
    return SilentMotorError(f"{what} on {source}{f' ({troubles[0]})' if troubles else ''}")


def read_device_id(channels: RobstrideLink, motor: int = 0) -> DeviceId:
    """Return who a motor is."""
    question = GetDeviceId(channels.motors.motor_id[motor], host_id=channels.host_id)
    found = channels.ask({motor: [question]}, lambda _, reply: reply if isinstance(reply, DeviceId) else None)
    if motor not in found:
        raise silence(channels, motor)
    return found[motor]


def command_motor(channels: RobstrideLink, command: Command) -> None:
    """Send a command that is answered by a status to the only motor."""
    if not channels.until_status({0: [command]}, lambda _: True):
        raise silence(channels)


def read_value(channels: RobstrideLink, parameter: Parameter) -> float | None:
    """Return a parameter's value of the only motor; none if it has no such parameter."""
    return _known(channels, channels.read({0: parameter})[0], 0)


def write_value(channels: RobstrideLink, parameter: Parameter, value: float, motor: int = 0) -> None:
    """Write a parameter and verify it; a `FieldError` if it does not fit, a `RobotError` if it reads otherwise."""
    found = _known(channels, channels.write(parameter, {motor: value})[motor], motor)
    if found is None or not parameter.is_same(found, value):
        reads = "nothing" if found is None else f"{found:g}"
        who = channels.motors.names[motor]
        raise RobotError(f"{who}: {parameter.name} reads {reads} after {value:g} was written")


def _known(channels: RobstrideLink, found: float | Unreadable, motor: int) -> float | None:
    if not isinstance(found, Unreadable):
        return found
    if found.is_silent:
        raise silence(channels, motor)
    return None


def title(family: str) -> str:
    """Return a family's name as it begins a sentence."""
    return family.capitalize()


def no_question(family: str) -> str:
    """Return why a motor of this family is not found."""
    return (
        f"the {title(family)} protocol has no question, so a motor that is not enabled stays silent and cannot be found"
    )


class Heard(NamedTuple):
    """Data received from one motor."""

    frames: int
    position: float
    """rad, motor frame."""
    velocity: float
    """rad/s"""


def heard_of(session: SitoMotors, motor: int) -> Heard:
    """Return what was heard of a motor; NaN for what was not."""
    readings = session.readings()
    reports = session.slots[motor].reports
    return Heard(reports, float(readings.position[motor]), float(readings.velocity[motor]))


class Ear:
    """Listens on all channels for the motors of a family, whatever their ids, and sends nothing."""

    def __init__(self, family: str, channels: RobstrideLink) -> None:
        traits = FAMILIES[family]
        self._places = [(channel, number) for channel in range(len(channels.sources)) for number in traits.ids]
        motors = some_motors(self._places, channels.sources, MOTORS[traits.models[0].name])
        self._link = SitoMotors(channels.line, motors, LinkTerms(channels.host_id, 0.0, FEEDBACK_PERIOD))
        channels.line.listeners.insert(0, self._link.receive)

    def heard(self) -> dict[tuple[int, int], Heard]:
        """Return what was heard of the motors that sent something, by channel and id."""
        places = enumerate(self._places)
        return {place: heard_of(self._link, i) for i, place in places if self._link.slots[i].reports}
