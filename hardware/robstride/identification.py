"""Identification of motors on the buses: every expected one once, on its channel, with firmware that can be driven."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

from humanoid_sim.hardware.bus.frame import BITRATE
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.robstride.codec import LARGEST_MOTOR_ID
from humanoid_sim.hardware.robstride.firmware import (
    FirmwareVersion,
    firmware_problem,
    firmware_question,
    firmware_warning,
    version_text,
)
from humanoid_sim.hardware.robstride.messages import DeviceId, GetDeviceId, ReadVersion, Reply, Version
from humanoid_sim.hardware.robstride.requests import RobstrideLink

Answers = dict[tuple[int, int], set[bytes]]
"""Unique ids that answered, by channel and motor id."""

_QUIET = 0.1
"""s without an answer that end the scan; motors answer within a few milliseconds."""


def identify(
    link: RobstrideLink,
    joints: Sequence[int],
    checks: CheckList,
    known_uids: Mapping[int, bytes],
    *,
    asks_everyone: bool,
    is_limp: bool,
) -> tuple[dict[int, bytes], dict[int, FirmwareVersion]]:
    """Ask on all channels who is there, and these motors for their firmware. Asks only; nothing is written.

    Args:
        known_uids: of an earlier activation, by joint: a motor that was exchanged since has another zero.
        asks_everyone: whether every id is asked, and strangers are mentioned.
        is_limp: no torque will be asked for: firmware that scales it wrongly, or that nobody knows, is a warning.

    Returns:
        Unique ids and firmware versions by joint, of the motors that answered.
    """
    motors = link.motors
    ids = range(1, LARGEST_MOTOR_ID + 1) if asks_everyone else sorted({motors.motor_id[i] for i in joints})
    answers: Answers = defaultdict(set)
    for channel, reply in link.scan(ids, _QUIET):
        answers[channel, reply.motor_id].add(reply.uid)
    _ask_again(link, joints, answers)
    uids: dict[int, bytes] = {}
    for channel, source in enumerate(link.sources):
        here = [i for i in motors.on_channel(channel) if i in joints]
        if len(here) > 1 and not any(answered == channel for answered, _ in answers):
            checks.problem(source, _dead_channel(link, channel))
            continue
        for i in here:
            problem = _problem(channel, motors.motor_id[i], answers, link.sources)
            if problem:
                checks.problem(motors.names[i], problem)
            uids.update((i, uid) for uid in answers.get((channel, motors.motor_id[i]), ()))
            if i in uids and known_uids.get(i, uids[i]) != uids[i]:
                text = f"its motor was exchanged (id {motors.motor_id[i]} on {source}): calibrate it"
                checks.problem(motors.names[i], text)
    for channel, motor_id in sorted(answers):
        if motor_id not in motors.motor_id:
            checks.warn(link.sources[channel], f"motor {motor_id} is not a joint of this robot; it is left alone")
    return uids, _check_versions(link, uids, checks, is_limp=is_limp)


def _dead_channel(link: RobstrideLink, channel: int) -> str:
    """Return what to look at when nobody answers on a channel."""
    invalid = (link.table.slots[i].invalid.text for i in link.motors.on_channel(channel))
    events = (*link.line.troubles(channel), *invalid)
    heard = "; ".join(dict.fromkeys(event for event in events if event))
    rate = BITRATE // 1_000_000
    question = f"no motor answers: are they powered, is the bus terminated, is it set to {rate} Mbit/s?"
    return f"{question} What was noticed: {heard}" if heard else question


def _ask_again(link: RobstrideLink, joints: Sequence[int], answers: Answers) -> None:
    """Ask those once more whose answer may have been lost."""
    motors = link.motors
    missing = {
        i: [GetDeviceId(motors.motor_id[i], host_id=link.host_id)]
        for i in joints
        if (motors.channel[i], motors.motor_id[i]) not in answers
    }
    found = link.ask(missing, lambda _, reply: reply.uid if isinstance(reply, DeviceId) else None)
    for joint, uid in found.items():
        answers[motors.channel[joint], motors.motor_id[joint]].add(uid)


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


def read_versions(link: RobstrideLink, joints: Sequence[int]) -> dict[int, FirmwareVersion]:
    """Return the firmware of these motors; one that does not know the question takes it for a stop, and is left out."""

    def version(_: int, reply: Reply) -> FirmwareVersion | None:
        return reply.version if isinstance(reply, Version) else None

    motor_id = link.motors.motor_id
    return link.ask({i: [ReadVersion(motor_id[i], host_id=link.host_id)] for i in joints}, version)


def _check_versions(
    link: RobstrideLink, uids: Mapping[int, bytes], checks: CheckList, *, is_limp: bool
) -> dict[int, FirmwareVersion]:
    motors = link.motors
    note = checks.warn if is_limp else checks.problem
    versions = read_versions(link, list(uids))
    for joint in sorted(uids):
        name, model = motors.names[joint], motors.model[joint]
        if joint not in versions:
            note(name, "does not tell its firmware's version, by which its model and its scales are known")
            continue
        problem = firmware_problem(model, versions[joint])
        if problem:
            note(name, problem)
            continue
        where = f"motor {motors.motor_id[joint]} on {link.sources[motors.channel[joint]]}"
        checks.passed(name, f"{where}, {model.name}, firmware {version_text(versions[joint])}, uid {uids[joint].hex()}")
        warning = firmware_warning(model, versions[joint])
        if warning:
            checks.warn(name, warning)
        question = firmware_question(model, versions[joint])
        if question and is_limp:
            checks.warn(name, question)
        elif question:
            checks.question(name, question, version_text(versions[joint]))
    return versions
