"""Motion that nobody asked for, on emulated motors: what is wired or measured wrongly, or held, ends in DAMPING.

No frame is wrong here and no motor complains: only the joints' motion shows it.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest
from campaign_rig import Campaign, campaign
from drive_rig import PERIOD, NotReachedError, Tick, quick_lite
from msgspec.structs import replace

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.emulation.faults import Fault
from humanoid_sim.hardware.emulation.settings import EmulationSettings
from humanoid_sim.messages import Intent, Mode
from humanoid_sim.robots.description import RobotDescription

SLOWNESS = (1.0, 2.0, 4.0, 8.0, 16.0)
INTENTS = {
    Mode.STANDBY: Intent.LOAD_A,
    Mode.LOCOMOTION: Intent.START_LOCOMOTION,
    Mode.REMOTE: Intent.START_REMOTE,
}
TOO_LATE = 0.035
"""s, as in the campaign of faults."""
FOLLOWING_TIME = 0.15
"""s, of an arm."""
QUICK = "flipped direction"
"""The row that every run of the tests has."""
SKEW = 0.3
"""N·m: a snapshot's torque is that of the velocity half a ms before."""


@dataclass(frozen=True)
class Row:
    """What is wrong, and what must come of it."""

    joint: str
    limit: float
    """N·m, its effort limit."""
    cause: str
    """With which the message ends."""
    mode: Mode = Mode.STANDBY
    """In which it shows."""
    direction: int | None = None
    """What the host takes for the joint's direction."""
    calibration: Mapping[str, float] = field(default_factory=dict)
    """rad, the host's homing offset, where the right one is 0."""
    zero: Mapping[str, float] = field(default_factory=dict)
    """rad, what the motor's own zero is off by."""
    elsewhere: Mapping[str, float] = field(default_factory=dict)
    """rad, where REMOTE sends the joint."""
    blocked: bool = False
    """The joint is held where it is from the moment in which the mode is asked for, or reached."""


IN_THE_WAY = "something in the way of {}, or its direction, homing offset or zero?"
ROWS = {
    "flipped direction": Row(
        "left_elbow_pitch", 14.0, "direction of left_elbow_pitch, or something that holds it?", direction=1
    ),
    "blocked joint": Row("left_wrist_yaw", 4.0, IN_THE_WAY.format("left_wrist_yaw"), blocked=True),
    "blocked joint in LOCOMOTION": Row(
        "left_elbow_pitch", 14.0, IN_THE_WAY.format("left_elbow_pitch"), Mode.LOCOMOTION, blocked=True
    ),
    "wrong homing offset": Row(
        "left_wrist_yaw", 4.0, IN_THE_WAY.format("left_wrist_yaw"), calibration={"left_wrist_yaw": -0.6}
    ),
    "wrong zero": Row("right_wrist_yaw", 4.0, IN_THE_WAY.format("right_wrist_yaw"), zero={"right_wrist_yaw": -0.6}),
    "command beyond the limit": Row(
        "left_wrist_yaw",
        4.0,
        "the command is beyond the limits of left_wrist_yaw",
        Mode.REMOTE,
        elsewhere={"left_wrist_yaw": -1.7},
    ),
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) for name in ROWS if name != QUICK] + [QUICK]
)
def test_it_ends_in_damping(name: str, table: list[tuple[str, ...]]) -> None:
    row = ROWS[name]
    problem = ""
    for slowness in SLOWNESS:
        try:
            ticks, running, problem = _run(row, slowness)
        except (NotReachedError, RobotError) as error:
            problem = str(error)
            continue
        if not problem:
            table.append((name, row.mode.name, *_judge(row, ticks, running), f"{slowness:g}"))
            return
    pytest.fail(f"the machine is too busy even in slow motion: {problem}", pytrace=False)


def _taken_for(row: Row) -> RobotDescription:
    lite = quick_lite()
    if row.direction is None:
        return lite
    joints = [
        replace(joint, motor=replace(joint.motor, direction=row.direction)) if joint.name == row.joint else joint
        for joint in lite.joints
    ]
    return replace(lite, joints=tuple(joints))


def _run(row: Row, slowness: float) -> tuple[list[Tick], Campaign, str]:
    """All ticks, and how the machine itself was late."""
    with campaign(
        slowness,
        settings=EmulationSettings(homing_offset=row.zero),
        description=_taken_for(row),
        calibration=row.calibration,
        elsewhere=row.elsewhere,
    ) as running:
        drive, motors = running.drive, running.motors
        drive.reach(Mode.DAMPING)
        count = len(drive.ticks)
        if row.mode is not Mode.STANDBY:
            drive.run(PERIOD, Intent.LOAD_A)
            drive.run(1.1)
        if row.blocked:
            motors.inject(Fault("blocked", (row.joint,), start=motors.time))
        intent = {Mode.STANDBY: Intent.LOAD_A, Mode.LOCOMOTION: Intent.START_LOCOMOTION}.get(
            row.mode, Intent.START_REMOTE
        )
        drive.run(2.0, intent)
        ticks = drive.ticks[count:]
        longest = max(late.read - early.read for early, late in itertools.pairwise(ticks))
        return ticks, running, f"{longest:.3f} s between ticks" if longest > TOO_LATE else ""


def _judge(row: Row, ticks: list[Tick], running: Campaign) -> tuple[str, str, str, str]:
    """The checks; for the table the guard, ms from half the effort limit to DAMPING, ms near the limit, and torque."""
    joint = running.drive.joints.index(row.joint)
    trip = next((tick for tick in ticks if tick.output.faults), None)
    assert trip is not None, "never noticed"
    assert all(tick.is_ok for tick in ticks), "no motor and no frame complains"
    assert {tick.mode for tick in ticks[: ticks.index(trip)]} >= {row.mode}
    (fault,) = trip.output.faults
    assert fault.message.startswith(f"following guard: {row.joint} does not follow: "), fault.message
    assert fault.message.endswith(row.cause), fault.message
    assert fault.fallback == "damping_controller"
    tail = ticks[ticks.index(trip) :]
    assert {tick.mode for tick in tail} == {Mode.DAMPING}, "in that tick, and nothing recovers by itself"

    harmless = {sent.motor_id for sent in running.sent if sent.time >= trip.read and sent.time <= trip.read + PERIOD}
    later = [sent for sent in running.sent if sent.time >= trip.read]
    assert len(harmless) == len(running.drive.joints), "one for every motor, within the tick"
    assert all(sent.has_damping and not sent.has_stiffness for sent in later), "and no other after it"

    pressing = [tick for tick in ticks if abs(tick.effort[joint]) >= 0.8 * row.limit]
    pressed = pressing[-1].read - pressing[0].read if pressing else 0.0
    assert pressed <= FOLLOWING_TIME + 6 * PERIOD  # a state is a tick old, and a busy machine makes it two
    late = [tick for tick in tail if tick.seen >= trip.read + PERIOD + 0.01]
    assert len(late) >= 10
    for tick in late:
        holding = np.abs(tick.effort) - 5.0 * np.abs(tick.velocity)
        assert holding.max() <= SKEW, "DAMPING presses nowhere"
        assert (tick.effort * tick.velocity <= 0.05 * SKEW).all(), "and takes energy away, whatever is wired wrongly"
    first = next(tick for tick in ticks if abs(tick.effort[joint]) >= 0.5 * row.limit)
    most = max(abs(float(tick.effort[joint])) for tick in ticks)
    left = max(abs(float(tick.effort[joint])) for tick in late[-10:])
    waited = 1e3 * (trip.read - first.read)
    return "following guard", f"{waited:.0f}", f"{1e3 * pressed:.0f} over 80 %", f"{most:.1f} → {left:.1f}"
