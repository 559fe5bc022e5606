"""`hardware discover`: which motors are on the buses."""

from __future__ import annotations

import time
from collections.abc import Mapping

from rich.markup import escape

from humanoid_sim.cli import ExitStatus, complain
from humanoid_sim.errors import InputError
from humanoid_sim.hardware.bus.address import parse_addresses
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.joints import Wiring, make_wiring
from humanoid_sim.hardware.robstride.codec import LARGEST_MOTOR_ID
from humanoid_sim.hardware.robstride.firmware import model_name, version_text
from humanoid_sim.hardware.robstride.identification import read_versions
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.sito.protocol import FROM_MOTOR, split_identifier
from humanoid_sim.hardware.tools.bench import make_console, make_table, open_bench, require_up, silence, some_motors
from humanoid_sim.hardware.tools.options import Discover
from humanoid_sim.robots.description import load_robot

_PACE = 0.02  # s to wait for each id
_LATE = 0.1  # s to wait for late answers at the end
_LISTENING = 0.3  # s in which an enabled Sito motor is received: its feedback comes every 255 ms at the latest

_Place = tuple[int, int]
"""Channel and motor id."""


class _SitoListener:
    """Counts the feedback of Sito motors, whatever their ids."""

    def __init__(self) -> None:
        self.frames: dict[_Place, int] = {}

    def receive(self, channel: int, frame: Frame, _: float) -> bool:
        """Take a frame; True if it is a Sito motor's."""
        parts = split_identifier(frame)
        if parts is not None and parts[1] in FROM_MOTOR:
            place = channel, parts[0]
            self.frames[place] = self.frames.get(place, 0) + 1
        return parts is not None


def discover(config: Discover) -> int:
    """Scan, print, and return the exit status."""
    if not 1 <= config.last <= LARGEST_MOTOR_ID:
        raise InputError(f"--last: is {config.last}, expected 1 to {LARGEST_MOTOR_ID}")
    addresses = parse_addresses(config.channels)
    wiring = None if config.robot is None else make_wiring(load_robot(config.robot), len(addresses))
    sito = _SitoListener()
    with open_bench(addresses, config.host_id, some_motors([], [])) as link:
        link.line.listeners.insert(0, sito.receive)
        end = time.monotonic() + _LISTENING
        found: dict[_Place, set[bytes]] = {}
        for channel, reply in link.scan(range(1, config.last + 1), _LATE, _PACE):
            found.setdefault((channel, reply.motor_id), set()).add(reply.uid)
        time.sleep(max(end - time.monotonic(), 0.0))
        require_up(link)
        found = dict(sorted(found.items()))
        answered = {channel for channel, _ in (*found, *sito.frames)}
        silent = [silence(link, i, "no motor answers") for i in range(len(addresses)) if i not in answered]
        firmware = _firmware(link, found) if config.firmware else {}
    _print(link.sources, found, firmware, wiring)
    for channel, device_id in sito.frames:
        print(f"Sito motor {device_id} on {link.sources[channel]} sends feedback: it is enabled")
    for error in silent:
        complain(str(error))
    missing = [] if wiring is None else _missing(wiring, link.sources, {*found, *sito.frames})
    if missing:
        complain(f"missing: {', '.join(missing)}")
    if not answered:
        return ExitStatus.NO_ANSWER
    return ExitStatus.FAILED if missing else 0


def _firmware(link: RobstrideLink, found: Mapping[_Place, set[bytes]]) -> dict[_Place, str]:
    link.expect(some_motors(list(found), link.sources))
    versions = read_versions(link, range(len(found)))
    texts = {i: f"{version_text(version)} ({model_name(version) or 'unknown'})" for i, version in versions.items()}
    return {place: texts.get(i, "unknown") for i, place in enumerate(found)}


def _missing(wiring: Wiring, sources: tuple[str, ...], there: set[_Place]) -> list[str]:
    """Return the joints whose motors do not answer; a Sito that is not enabled stays silent and may be there."""
    absent = [i for i in range(wiring.count) if (wiring.channel[i], wiring.motor_id[i]) not in there]
    if unasked := [i for i in absent if i in wiring.unasked]:
        names = ", ".join(f"{wiring.names[i]} (motor {wiring.motor_id[i]})" for i in unasked)
        print(f"not enabled, or not there: {names}; Sito motors have no questions")
    places = [(i, f"motor {wiring.motor_id[i]} on {sources[wiring.channel[i]]}") for i in absent if i not in unasked]
    return [f"{wiring.names[i]} ({where})" for i, where in places]


def _print(
    sources: tuple[str, ...],
    found: Mapping[_Place, set[bytes]],
    firmware: Mapping[_Place, str],
    wiring: Wiring | None,
) -> None:
    if not found:
        return
    joints = (
        {}
        if wiring is None
        else dict(zip(zip(wiring.channel, wiring.motor_id, strict=True), wiring.names, strict=True))
    )
    headings = ["channel", "id", "unique id", *["firmware"] * bool(firmware), *["joint"] * (wiring is not None)]
    table = make_table(*headings, right=("id",))
    for place, uids in found.items():
        row = [escape(sources[place[0]]), str(place[1]), " and ".join(sorted(uid.hex() for uid in uids))]
        row += [firmware[place]] if firmware else []
        row += [] if wiring is None else [escape(joints.get(place, "none of this robot's"))]
        table.add_row(*row)
        if len(uids) > 1:
            complain(
                f"{len(uids)} motors on {sources[place[0]]} have the id {place[1]}: connect one alone, then set-id"
            )
    make_console().print(table)
