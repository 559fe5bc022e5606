"""Everything before a robot is enabled: who is there, are they stopped and sound, where are they, what may they do."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from humanoid_sim.hardware.adapter.joint_tracking import WRAP, find_turns, turn_problems
from humanoid_sim.hardware.adapter.wiring import AdapterSettings, Wiring
from humanoid_sim.hardware.bus.frame import bus_load
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.robstride.enabling import examine, make_ready, set_reports
from humanoid_sim.hardware.robstride.firmware import FirmwareVersion, firmware_of
from humanoid_sim.hardware.robstride.open_channels import OpenChannels
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, report_interval
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.schema import RobotDescription

__all__ = ["Prepared", "gain_warnings", "prepare_motors"]


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
    uids: Mapping[int, bytes]
    """By joint."""
    reporting: tuple[int, ...]
    """Joints whose motors were told to send their state by themselves."""


def prepare_motors(
    settings: AdapterSettings, channels: OpenChannels, known_uids: Mapping[int, bytes], checks: CheckList
) -> Prepared:
    """Identify, stop, configure and verify; leaves the motors stopped.

    Nothing is written to any motor before every expected one has been identified and nobody else drives them.

    Args:
        settings: the robot's.
        channels: open.
        known_uids: unique ids of the motors at an earlier activation, by joint.
        checks: takes what is found.

    Raises:
        RobotError: with everything that is wrong.
    """
    joints = range(settings.wiring.count)
    uids, versions = examine(channels, joints, checks, known_uids=known_uids, takes_over=True)
    make_ready(channels, joints, settings.can_timeout, checks, takes_over=True)
    _read_supply(channels, checks)
    turns = _find_positions(settings.wiring, channels, checks)
    checks.refuse()
    reporting = _start_reports(settings, channels, versions, checks)
    channels.check(checks)
    checks.refuse()
    return Prepared(turns, uids, reporting)


def _read_supply(channels: OpenChannels, checks: CheckList) -> None:
    """Show the supply voltage of each channel's motors."""
    motors = channels.motors
    found = channels.requests.read(dict.fromkeys(range(motors.count), PARAMETERS["VBUS"]))
    for channel, source in enumerate(channels.sources):
        volts = [v for i in motors.on_channel(channel) if isinstance(v := found[i], float)]
        if volts:
            checks.passed(source, f"supply {min(volts):.1f} to {max(volts):.1f} V at its motors")
        else:
            checks.warn(source, "no motor tells its supply voltage")


def _find_positions(wiring: Wiring, channels: OpenChannels, checks: CheckList) -> FloatArray:
    """The turns of `find_turns`."""
    position = channels.table.readings().position
    turns = find_turns(wiring, position)
    wrong = dict(turn_problems(wiring, position, turns))
    for joint, text in wrong.items():
        checks.problem(joint, text)
    counted = channels.requests.read(dict.fromkeys(range(wiring.count), PARAMETERS["mechPos"]))
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
    return turns


def _start_reports(
    settings: AdapterSettings,
    channels: OpenChannels,
    versions: Mapping[int, FirmwareVersion],
    checks: CheckList,
) -> tuple[int, ...]:
    """Switch active reports on where they help: a motor otherwise answers commands only, a whole period too early."""
    wiring, period = settings.wiring, settings.control_period
    able = [i for i in range(wiring.count) if firmware_of(wiring.model[i], versions[i]).has_active_reports]
    wanted = []
    for channel, source in enumerate(channels.sources):
        motors = wiring.on_channel(channel)
        interval = report_interval(_SCAN_TIME)
        load = bus_load(len(motors) * (2.0 / period + 1.0 / interval))
        if interval >= period:
            checks.passed(source, "no active reports: commands are answered as often")
        elif load > _FULL_BUS:
            checks.passed(source, f"no active reports: they would load the bus to {100.0 * load:.0f} %")
        else:
            wanted += [i for i in motors if i in able]
    channels.requests.write(PARAMETERS["EPScan_time"], dict.fromkeys(wanted, float(_SCAN_TIME)))
    slots = channels.table.slots
    before = [slot.reports + slot.statuses for slot in slots]

    def silent() -> list[int]:
        """Joints whose motors sent no more than one status: that may have answered the request."""
        return [i for i in wanted if slots[i].reports + slots[i].statuses <= before[i] + 1]

    set_reports(channels.requests, wanted, is_on=True)
    channels.wait(lambda: not silent(), _REPORT_WAIT)
    for i in silent():
        checks.warn(wiring.names[i], "sends no active reports: its state is a control period old")
    return tuple(wanted)


def gain_warnings(description: RobotDescription, wiring: Wiring) -> Iterator[tuple[str, str]]:
    """Joint and what is cut off there: a controller's gain beyond its motor's range. A policy's are checked with it."""
    n = wiring.count
    standby = (
        ("standby_controller_a", description.standby_controller_a),
        ("standby_controller_b", description.standby_controller_b),
    )
    passive = (
        ("damping_controller", description.damping_controller),
        ("remote_policy_controller", description.remote_policy_controller),
    )
    stiffness = [model.stiffness for model in wiring.model]
    damping = [model.damping for model in wiring.model]
    for name, settings in standby:
        yield from _beyond(wiring, f"{name}.target_stiffness", settings.target_stiffness, stiffness)
        yield from _beyond(wiring, f"{name}.target_damping", settings.target_damping, damping)
    for name, values in passive:
        yield from _beyond(wiring, f"{name}'s damping", values.damping or (values.damping_scalar,) * n, damping)


def _beyond(wiring: Wiring, what: str, gains: Sequence[float], limits: Sequence[float]) -> Iterator[tuple[str, str]]:
    for i, (gain, limit) in enumerate(zip(gains, limits, strict=True)):
        if gain > limit:
            yield wiring.names[i], f"{what} is {gain:g}, an {wiring.model[i].name} is told {limit:g} at most"
