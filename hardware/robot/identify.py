"""Who is on the buses: every expected motor once, on its channel, with a firmware that can be driven."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

from humanoid_sim.hardware.bus.events import BusEvent
from humanoid_sim.hardware.bus.frame import BITRATE
from humanoid_sim.hardware.robot.checks import CheckList
from humanoid_sim.hardware.robot.firmware_checks import firmware_problem, firmware_warning
from humanoid_sim.hardware.robot.link import Link
from humanoid_sim.hardware.robot.requests import Requests
from humanoid_sim.hardware.robstride.commands import LARGEST_MOTOR_ID
from humanoid_sim.hardware.robstride.firmware import FirmwareVersion, version_text
from humanoid_sim.hardware.robstride.messages import DeviceId, GetDeviceId, ReadVersion, Reply, Version

__all__ = ["identify"]

Answers = dict[tuple[int, int], set[bytes]]
"""Unique ids that answered, by channel and motor id."""

_QUIET = 0.1
"""s without an answer that end the scan; motors answer within a few milliseconds."""


def identify(
    link: Link, known_uids: Mapping[int, bytes], checks: CheckList
) -> tuple[dict[int, bytes], dict[int, FirmwareVersion]]:
    """Scan all ids on all channels and read the firmware of the robot's motors. Asks only; nothing is written.

    Args:
        link: the open channels.
        known_uids: of an earlier activation, by joint: a motor that was exchanged since has another zero.
        checks: takes what was found.

    Returns:
        Unique ids and firmware versions by joint, of the motors that answered.
    """
    wiring = link.requests.wiring
    answers: Answers = defaultdict(set)
    for channel, reply in link.requests.scan(range(1, LARGEST_MOTOR_ID + 1), _QUIET):
        answers[channel, reply.motor_id].add(reply.uid)
    _ask_again(link.requests, answers)
    uids: dict[int, bytes] = {}
    for channel, source in enumerate(link.sources):
        joints = wiring.on_channel(channel)
        if len(joints) > 1 and not any(answered == channel for answered, _ in answers):
            checks.problem(source, _dead_channel(link, channel))
            continue
        for i in joints:
            problem = _problem(channel, wiring.motor_id[i], answers, link.sources)
            if problem:
                checks.problem(wiring.names[i], problem)
            uids.update((i, uid) for uid in answers.get((channel, wiring.motor_id[i]), ()))
            if i in uids and known_uids.get(i, uids[i]) != uids[i]:
                text = f"its motor was exchanged (id {wiring.motor_id[i]} on {source}): calibrate it"
                checks.problem(wiring.names[i], text)
    for channel, motor_id in sorted(answers):
        if motor_id not in wiring.motor_id:
            checks.warn(link.sources[channel], f"motor {motor_id} is no joint of this robot; it is left alone")
    return uids, _versions(link, uids, checks)


def _dead_channel(link: Link, channel: int) -> str:
    """What to look at when nobody answers on a channel."""
    interface = link.channels[channel]
    events = [interface.down, *(interface.recent(event, link.opened) for event in BusEvent)]
    slots = link.table.slots
    events += [slots[i].invalid.text for i in link.requests.wiring.on_channel(channel)]
    heard = "; ".join(dict.fromkeys(event for event in events if event))
    rate = BITRATE // 1_000_000
    question = f"no motor answers: are they powered, is the bus terminated, is it set to {rate} Mbit/s?"
    return f"{question} What was noticed: {heard}" if heard else question


def _ask_again(requests: Requests, answers: Answers) -> None:
    """Ask those once more whose answer may have been lost."""
    wiring = requests.wiring

    def uid(_: int, reply: Reply) -> bytes | None:
        return reply.uid if isinstance(reply, DeviceId) else None

    missing = {
        i: [GetDeviceId(wiring.motor_id[i], host_id=requests.host_id)]
        for i in range(wiring.count)
        if (wiring.channel[i], wiring.motor_id[i]) not in answers
    }
    for joint, found in requests.ask(missing, uid).items():
        answers[wiring.channel[joint], wiring.motor_id[joint]].add(found)


def _problem(channel: int, motor_id: int, answers: Answers, sources: Sequence[str]) -> str:
    found = answers.get((channel, motor_id), set())
    elsewhere = [sources[other] for other, answered in answers if answered == motor_id and other != channel]
    if not found:
        hint = f"; {', '.join(elsewhere)} has a motor {motor_id}: are the channels swapped?" if elsewhere else ""
        return f"motor {motor_id} does not answer on {sources[channel]}{hint}"
    if len(found) > 1:
        uids = " and ".join(sorted(uid.hex() for uid in found))
        return f"{len(found)} motors answer as {motor_id} on {sources[channel]} (uid {uids})"
    if elsewhere:
        return f"a second motor {motor_id} answers on {', '.join(elsewhere)}"
    return ""


def _versions(link: Link, uids: Mapping[int, bytes], checks: CheckList) -> dict[int, FirmwareVersion]:
    requests = link.requests
    wiring = requests.wiring

    def version(_: int, reply: Reply) -> FirmwareVersion | None:
        return reply.version if isinstance(reply, Version) else None

    questions = {joint: [ReadVersion(wiring.motor_id[joint], host_id=requests.host_id)] for joint in uids}
    versions = requests.ask(questions, version)
    for joint in sorted(uids):
        name, model = wiring.names[joint], wiring.model[joint]
        if joint not in versions:
            checks.problem(name, "does not tell its firmware's version, by which its model and its scales are known")
            continue
        problem = firmware_problem(model, versions[joint])
        if problem:
            checks.problem(name, problem)
            continue
        where = f"motor {wiring.motor_id[joint]} on {link.sources[wiring.channel[joint]]}"
        checks.passed(name, f"{where}, {model.name}, firmware {version_text(versions[joint])}, uid {uids[joint].hex()}")
        warning = firmware_warning(model, versions[joint])
        if warning:
            checks.warn(name, warning)
    return versions
