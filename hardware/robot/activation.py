"""Everything before a motor is enabled: who is there, are they stopped and sound, where are they, what may they do."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.bus.frame import bus_load
from humanoid_sim.hardware.robot.checks import CheckList
from humanoid_sim.hardware.robot.configure import configure, read_supply
from humanoid_sim.hardware.robot.identify import identify
from humanoid_sim.hardware.robot.link import Link
from humanoid_sim.hardware.robot.parameter_access import ParameterAccess
from humanoid_sim.hardware.robot.requests import Requests
from humanoid_sim.hardware.robot.settings import AdapterSettings
from humanoid_sim.hardware.robot.stopping import stop_and_clear
from humanoid_sim.hardware.robot.turns import WRAP, find_turns, turn_problems
from humanoid_sim.hardware.robot.wiring import Wiring
from humanoid_sim.hardware.robstride.firmware import FirmwareVersion, firmware_of
from humanoid_sim.hardware.robstride.messages import SetActiveReport
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, report_interval
from humanoid_sim.mit import FloatArray

__all__ = ["Prepared", "prepare_motors", "set_reports"]

_LISTENING = 0.05
"""s of silence in which another host would be heard, before anything is sent."""
_REPORT_WAIT = 0.3
"""s at most in which the first active reports must come."""
_SCAN_TIME = 1
"""`EPScan_time` of the shortest report interval."""
_FULL_BUS = 0.6
"""Share of a bus up to which active reports are worth their frames."""


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """Motors that may be enabled."""

    turns: FloatArray
    """Shape (n,), see `find_turns`."""
    position: FloatArray
    """Shape (n,), rad, motor frame."""
    uids: Mapping[int, bytes]
    """By joint."""
    reporting: tuple[int, ...]
    """Joints whose motors were told to send their state by themselves."""


def prepare_motors(
    settings: AdapterSettings, link: Link, known_uids: Mapping[int, bytes], checks: CheckList
) -> Prepared:
    """Identify, stop, configure and verify; leaves the motors stopped.

    Nothing is written to any motor before every expected one has been identified and nobody else drives them.

    Args:
        settings: the robot's.
        link: its open channels.
        known_uids: unique ids of the motors at an earlier activation, by joint.
        checks: takes what is found.

    Raises:
        RobotError: with everything that is wrong.
    """
    name, requests = settings.name, link.requests
    link.listen(_LISTENING)
    _refuse_intruders(link, checks)
    _refuse(checks, name)
    uids, versions = identify(link, known_uids, checks)
    _refuse(checks, name)
    access = ParameterAccess(requests)
    stop_and_clear(requests, access, checks)
    configure(settings.wiring, access, settings.can_timeout, checks)
    read_supply(settings.wiring, access, link.sources, checks)
    turns, position = _find_positions(settings.wiring, link, access, checks)
    _refuse(checks, name)
    reporting = _start_reports(settings, link, access, versions, checks)
    _refuse_intruders(link, checks)
    for source, channel in zip(link.sources, link.channels, strict=True):
        if channel.down:
            checks.problem(source, f"down: {channel.down}")
    _refuse(checks, name)
    return Prepared(turns, position, uids, reporting)


def _refuse(checks: CheckList, name: str) -> None:
    if checks.problems:
        raise RobotError(checks.refusal(name))


def _refuse_intruders(link: Link, checks: CheckList) -> None:
    for source, text in link.intruders:
        checks.problem(source, f"another master drives these motors: {text}")


def _find_positions(
    wiring: Wiring, link: Link, access: ParameterAccess, checks: CheckList
) -> tuple[FloatArray, FloatArray]:
    position = link.table.readings().position
    turns = find_turns(wiring, position)
    wrong = dict(turn_problems(wiring, position, turns))
    for joint, text in wrong.items():
        checks.problem(joint, text)
    counted = access.read(dict.fromkeys(range(wiring.count), PARAMETERS["mechPos"]))
    for i, name in enumerate(wiring.names):
        own = counted[i]
        if not isinstance(own, float):
            checks.warn(name, "mechPos cannot be read: whether it turned beyond ±4π since power-on is not known")
        elif not abs(own - position[i]) < 0.5 * WRAP:  # they differ by whole periods, and by the motion in between
            checks.problem(
                name,
                f"counts {own:.2f} rad by itself and reports {position[i]:.2f}: it turned beyond ±4π since power-on; "
                "switch it off and on",
            )
        elif name not in wrong:
            joint = wiring.direction[i] * (position[i] + 2.0 * np.pi * turns[i] - wiring.offset[i])
            counts = f" ({turns[i]:+.0f} turn)" if turns[i] else ""
            checks.passed(name, f"at {round(joint, 3) + 0.0:.3f} rad{counts}")
    return turns, position


def _start_reports(
    settings: AdapterSettings,
    link: Link,
    access: ParameterAccess,
    versions: Mapping[int, FirmwareVersion],
    checks: CheckList,
) -> tuple[int, ...]:
    """Switch active reports on where they help: a motor otherwise answers commands only, a whole period too early."""
    wiring, period = settings.wiring, settings.control_period
    able = [i for i in range(wiring.count) if firmware_of(wiring.model[i], versions[i]).has_active_reports]
    wanted = []
    for channel, source in enumerate(link.sources):
        motors = wiring.on_channel(channel)
        interval = report_interval(_SCAN_TIME)
        load = bus_load(len(motors) * (2.0 / period + 1.0 / interval))
        if interval >= period:
            checks.passed(source, "no active reports: commands are answered as often")
        elif load > _FULL_BUS:
            checks.passed(source, f"no active reports: they would load the bus to {100.0 * load:.0f} %")
        else:
            wanted += [i for i in motors if i in able]
    access.write(PARAMETERS["EPScan_time"], dict.fromkeys(wanted, float(_SCAN_TIME)))
    slots = link.table.slots
    before = [slot.reports + slot.statuses for slot in slots]

    def silent() -> list[int]:
        """Joints whose motors sent no more than one status: that may have answered the request."""
        return [i for i in wanted if slots[i].reports + slots[i].statuses <= before[i] + 1]

    set_reports(link.requests, wanted, is_on=True)
    link.wait(lambda: not silent(), _REPORT_WAIT)
    for i in silent():
        checks.warn(wiring.names[i], "sends no active reports: its state is a control period old")
    return tuple(wanted)


def set_reports(requests: Requests, joints: Iterable[int], *, is_on: bool) -> None:
    """Switch the active reports of these joints' motors on or off; not verified."""
    motor_id = requests.wiring.motor_id
    requests.send({i: [SetActiveReport(motor_id[i], is_on, host_id=requests.host_id)] for i in joints})
