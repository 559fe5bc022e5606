"""`hardware discover`: who is on the buses."""

from __future__ import annotations

import time
from collections.abc import Container, Mapping, Sequence

from rich.markup import escape

from humanoid_sim.cli import ExitStatus, complain
from humanoid_sim.errors import InputError
from humanoid_sim.hardware.bus.address import BusAddress, parse_addresses
from humanoid_sim.hardware.joints import Wiring, make_wiring
from humanoid_sim.hardware.robstride.codec import LARGEST_MOTOR_ID
from humanoid_sim.hardware.robstride.firmware import model_name, version_text
from humanoid_sim.hardware.robstride.identification import read_versions
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.tools.bench import (
    LISTENING,
    Ear,
    Heard,
    advice_for_silence,
    no_question,
    open_bench,
    require_up,
    some_motors,
    title,
)
from humanoid_sim.hardware.tools.options import Discover
from humanoid_sim.hardware.tools.terminal import make_console, make_table
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.motors import FAMILIES

_LATE = 0.1
"""s to wait for late answers at the end."""

_Place = tuple[int, int]
"""Channel and motor id."""
_Found = Mapping[_Place, set[bytes]]
"""Unique ids."""


def discover(config: Discover) -> int:
    """Scan, print, and return the exit status."""
    if not 1 <= config.first <= config.last <= LARGEST_MOTOR_ID:
        raise InputError(f"--first, --last: are {config.first} and {config.last}, expected 1 <= first <= last <= 127")
    if not 0.0 < config.wait <= 10.0:
        raise InputError(f"--wait: is {config.wait}, expected more than 0 and at most 10 s")
    addresses = parse_addresses(config.channels)
    wiring = None
    if config.robot is not None:
        description = load_robot(config.robot)
        wiring = make_wiring(description, len(addresses))
    with open_bench(addresses, config.host_id, some_motors([], [])) as channels:
        ears = {name: Ear(name, channels) for name, family in FAMILIES.items() if not family.has_questions}
        end = time.monotonic() + LISTENING
        found: dict[_Place, set[bytes]] = {}
        for channel, reply in channels.scan(range(config.first, config.last + 1), _LATE, config.wait):
            found.setdefault((channel, reply.motor_id), set()).add(reply.uid)
        time.sleep(max(end - time.monotonic(), 0.0))
        require_up(channels)
        found = dict(sorted(found.items()))
        firmware = _firmware(channels, found) if config.firmware else None
        troubles = [channels.line.troubles(i) for i in range(len(addresses))]
        heard = {name: ear.heard() for name, ear in ears.items()}
    joints = {} if wiring is None else _joints(wiring, [name for name in FAMILIES if name not in heard])
    if found:
        _print(addresses, found, firmware, joints if wiring is not None else None)
    for family, motors in heard.items():
        _print_heard(addresses, family, motors, wiring)
    speaking = {*found, *(place for motors in heard.values() for place in motors)}
    for i, address in enumerate(addresses):
        if not any(channel == i for channel, _ in speaking):
            trouble = f" ({troubles[i][0]})" if troubles[i] else ""
            complain(f"no motor answers on {address}{trouble}: ids {config.first} to {config.last} were asked")
            for line in advice_for_silence(str(address)):
                complain(f"  {line}")
    if not speaking:
        return ExitStatus.NO_ANSWER
    missing = _absent(joints, found, addresses)
    if missing:
        complain(f"missing: {missing}")
    return ExitStatus.FAILED if missing else 0


def _firmware(channels: RobstrideLink, found: _Found) -> dict[_Place, str]:
    channels.expect(some_motors(list(found), channels.sources))
    versions = read_versions(channels, range(len(found)))
    texts = {}
    for i, place in enumerate(found):
        version = versions.get(i)
        model = None if version is None else model_name(version)
        texts[place] = "unknown" if version is None else f"{version_text(version)} ({model or 'unknown'})"
    return texts


def _joints(wiring: Wiring, families: Sequence[str]) -> dict[_Place, str]:
    motors = [i for family in families for i in wiring.of_family(family)]
    return {(wiring.channel[i], wiring.motor_id[i]): wiring.names[i] for i in sorted(motors)}


def _absent(joints: Mapping[_Place, str], there: Container[_Place], addresses: Sequence[BusAddress]) -> str:
    """Return the joints whose motors are not there, and where they were expected."""
    return ", ".join(
        f"{name} (motor {place[1]} on {addresses[place[0]]})" for place, name in joints.items() if place not in there
    )


def _print_heard(
    addresses: tuple[BusAddress, ...], family: str, heard: Mapping[_Place, Heard], wiring: Wiring | None
) -> None:
    """Print which motors of a family without questions were heard, and that the others may be there all the same."""
    joints = {} if wiring is None else _joints(wiring, [family])
    for (channel, device_id), motor in heard.items():
        joint = joints.get((channel, device_id), "" if wiring is None else "none of this robot's")
        name = f" ({joint})" if joint else ""
        where = f"{title(family)} motor {device_id} on {addresses[channel]}{name}"
        print(f"{where} sends feedback, so it is enabled: {motor.frames} frames")
    if silent := _absent(joints, heard, addresses):
        print(f"not heard: {silent}; that proves nothing: {no_question(family)}")


def _print(
    addresses: tuple[BusAddress, ...],
    found: _Found,
    firmware: Mapping[_Place, str] | None,
    joints: Mapping[_Place, str] | None,
) -> None:
    optional = [name for name, column in (("firmware", firmware), ("joint", joints)) if column is not None]
    table = make_table("channel", "id", "unique id", *optional, right=("id",))
    for (channel, motor_id), uids in found.items():
        row = [escape(str(addresses[channel])), str(motor_id), " and ".join(sorted(uid.hex() for uid in uids))]
        if firmware is not None:
            row.append(firmware[channel, motor_id])
        if joints is not None:
            row.append(escape(joints.get((channel, motor_id), "none of this robot's")))
        table.add_row(*row)
    make_console().print(table)
    for (channel, motor_id), uids in found.items():
        if len(uids) > 1:
            complain(
                f"{len(uids)} motors on {addresses[channel]} have the id {motor_id}: connect one alone and give it "
                "another id: python -m humanoid_sim.hardware set-id"
            )
