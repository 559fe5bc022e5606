"""Identification of motors on the buses: every expected one once, on its channel, with firmware that can be driven."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence

from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.robstride.firmware import (
    FirmwareVersion,
    firmware_problem,
    firmware_question,
    position_range,
    version_text,
)
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.messages import DeviceId, GetDeviceId, ReadVersion, Reply, Version

Answers = Mapping[tuple[int, int], set[bytes]]  # unique ids that answered, by channel and motor id

_QUIET = 0.1  # s without an answer that end the scan; motors answer within a few milliseconds


def identify(
    link: RobstrideLink, checks: CheckList, known_uids: Mapping[str, bytes]
) -> tuple[dict[str, bytes], dict[int, FirmwareVersion]]:
    """Return the motors' unique ids, by joint's name, and their firmware, by index. Writes nothing.

    `known_uids`: of an earlier activation; a motor that was exchanged since has another zero.
    """
    motors, sources = link.motors, link.sources
    answers: defaultdict[tuple[int, int], set[bytes]] = defaultdict(set)
    for channel, reply in link.scan(sorted(set(motors.motor_id)), _QUIET):
        answers[channel, reply.motor_id].add(reply.uid)
    places = list(zip(motors.channel, motors.motor_id, strict=True))
    again = [i for i, place in enumerate(places) if place not in answers]  # an answer may have been lost
    questions = {i: [GetDeviceId(motors.motor_id[i])] for i in again}
    found = link.ask(questions, lambda _, reply: reply.uid if isinstance(reply, DeviceId) else None)
    for i, uid in found.items():
        answers[places[i]].add(uid)
    uids: dict[int, bytes] = {}
    for i, (channel, motor_id) in enumerate(places):
        name = motors.names[i]
        if problem := _problem(channel, motor_id, answers, sources):
            hints = link.line.troubles(channel)
            checks.problem(name, f"{problem} ({'; '.join(hints)})" if hints else problem)
        uids.update((i, uid) for uid in answers.get(places[i], ()))
        if i in uids and known_uids.get(name, uids[i]) != uids[i]:
            checks.problem(name, f"its motor was exchanged (id {motor_id} on {sources[channel]}): calibrate it")
    return {motors.names[i]: uid for i, uid in uids.items()}, _check_versions(link, uids, checks)


def _problem(channel: int, motor_id: int, answers: Answers, sources: Sequence[str]) -> str:
    uids = sorted(uid.hex() for uid in answers.get((channel, motor_id), ()))
    elsewhere = ", ".join(sources[other] for other, answered in answers if answered == motor_id and other != channel)
    if not uids:
        return f"motor {motor_id} does not answer on {sources[channel]}{f', but on {elsewhere}' if elsewhere else ''}"
    if len(uids) > 1:
        return f"{len(uids)} motors answer as {motor_id} on {sources[channel]} (uid {' and '.join(uids)})"
    return f"a second motor {motor_id} answers on {elsewhere}" if elsewhere else ""


def read_versions(link: RobstrideLink, joints: Iterable[int]) -> dict[int, FirmwareVersion]:
    """Return the firmware of these motors; one that does not know the question takes it for a stop, and is left out."""

    def version(_: int, reply: Reply) -> FirmwareVersion | None:
        return reply.version if isinstance(reply, Version) else None

    return link.ask({i: [ReadVersion(link.motors.motor_id[i])] for i in joints}, version)


def _check_versions(link: RobstrideLink, uids: Mapping[int, bytes], checks: CheckList) -> dict[int, FirmwareVersion]:
    motors = link.motors
    versions = read_versions(link, uids)
    for i in sorted(uids):
        name, model = motors.names[i], motors.model[i]
        if i not in versions:
            checks.problem(name, "does not report its firmware's version, by which its model and its scales are known")
            continue
        version = versions[i]
        if problem := firmware_problem(model, version):
            checks.problem(name, problem)
            continue
        where = f"motor {motors.motor_id[i]} on {link.sources[motors.channel[i]]}"
        checks.passed(name, f"{where}, {model.name}, firmware {version_text(version)}, uid {uids[i].hex()}")
        found = position_range(model, version)
        if found != model.position:
            checks.warn(name, f"firmware {version_text(version)} counts ±{found:g} rad: angles are off by 0.5 %")
        if question := firmware_question(model, version):
            checks.question(name, question, version_text(version))
    return versions
