"""`hardware discover`: which motors are on the buses."""

from __future__ import annotations

from rich.markup import escape

from humanoid_sim.cli import ExitStatus, complain
from humanoid_sim.hardware.can_bus import parse_addresses
from humanoid_sim.hardware.joints import Wiring, make_wiring
from humanoid_sim.hardware.motor_link import MotorGroup
from humanoid_sim.hardware.robstride.protocol import LARGEST_MOTOR_ID
from humanoid_sim.hardware.tools import bench
from humanoid_sim.hardware.tools.options import Discover
from humanoid_sim.robots.description import load_robot

_PACE = 0.02  # s to wait for each id
_LATE = 0.3  # s to wait for late answers


def discover(config: Discover) -> int:
    """Scan, print, and return the exit status."""
    addresses = parse_addresses(config.channels)
    wiring = None if config.robot is None else make_wiring(load_robot(config.robot), len(addresses))
    with bench.open_bench(addresses) as link:
        sources = link.sources
        found: dict[tuple[int, int], set[str]] = {}  # unique ids by channel and motor id
        for channel, reply in link.scan(range(1, LARGEST_MOTOR_ID + 1), _LATE, _PACE):
            found.setdefault((channel, reply.motor_id), set()).add(reply.uid.hex())
        bench.check_channels(link)
        silent = set(range(len(addresses))) - {channel for channel, _ in found}
        errors = [bench.silence(link, channel, "no motor answers") for channel in sorted(silent)]
    joints = {} if wiring is None else dict(zip(_places(wiring), wiring.names, strict=True))
    rows = [
        (escape(sources[place[0]]), str(place[1]), " and ".join(sorted(uids)), escape(joints.get(place, "")))
        for place, uids in sorted(found.items())
    ]
    if rows:
        bench.make_console().print(bench.make_table(("channel", "id", "unique id", "joint"), rows))
    for (channel, motor_id), uids in found.items():
        if len(uids) > 1:
            complain(f"{len(uids)} motors on {sources[channel]} have the id {motor_id}: connect one alone, then set-id")
    for error in errors:
        complain(str(error))
    missing = [] if wiring is None else _missing(wiring, sources, set(found))
    if missing:
        complain(f"missing: {', '.join(missing)}")
    if not found:
        return ExitStatus.NO_ANSWER
    return ExitStatus.FAILED if missing else 0


def _places(motors: MotorGroup) -> list[tuple[int, int]]:
    """Return channel and id of every motor."""
    return list(zip(motors.channel, motors.motor_id, strict=True))


def _missing(wiring: Wiring, sources: tuple[str, ...], there: set[tuple[int, int]]) -> list[str]:
    """Return the joints whose motors do not answer; a Sito has no questions and may be there."""
    names = {
        i: f"{wiring.names[i]} (motor {motor_id} on {sources[channel]})"
        for i, (channel, motor_id) in enumerate(_places(wiring))
        if (channel, motor_id) not in there
    }
    if unasked := [name for i, name in names.items() if i in wiring.unasked]:
        print(f"not asked: {', '.join(unasked)}: Sito motors have no questions")
    return [name for i, name in names.items() if i not in wiring.unasked]
