"""Motion that nobody asked for, on emulated motors: what is wired or measured wrongly, or held, ends in DAMPING.

No frame is wrong here and no motor complains: only the joints' motion shows it.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest
from campaign_rig import campaign
from drive_rig import PERIOD, Ask, NotReachedError, quick_lite
from msgspec.structs import replace

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.emulation.faults import Fault
from humanoid_sim.hardware.emulation.settings import EmulationSettings
from humanoid_sim.messages import Intent, Mode
from humanoid_sim.robots.schema import GuardSettings, SpeedGuard

pytestmark = pytest.mark.soak

SLOWNESS = (1.0, 2.0, 4.0, 8.0, 16.0)
INTENTS = {Mode.STANDBY: Intent.LOAD_A, Mode.LOCOMOTION: Intent.START_LOCOMOTION, Mode.REMOTE: Intent.START_REMOTE}
TOO_LATE = 0.035
"""s, as in the campaign of faults."""
TIMES = {"following": 0.15, "limit": 0.1, "speed": 0.02}
"""s after which a guard of an arm trips."""
MARGIN = 0.15
"""rad beyond its limit that a joint may be."""
SPEEDS = {"lite": 8.0, "lite_sito": 3.11}
"""rad/s: what a robot's file says, or what a Sito can report."""
AFTERWARDS = 0.5
"""s that are watched once a guard has tripped."""
SKEW = 0.3
"""N·m: a snapshot's torque is that of the velocity half a ms before."""


@dataclass(frozen=True)
class Row:
    """What is wrong, and what must come of it."""

    joint: str
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
    ask: Ask | None = None
    """What REMOTE wants of the joint."""
    guard: str = "following"
    """Which one trips."""
    robot: str = "lite"
    """With which motors the Lite is."""
    blocked: bool = False
    """The joint is held where it is from the moment in which the mode is asked for, or reached."""

    @property
    def limit(self):
        """N·m, the joint's effort limit."""
        return 14.0 if self.joint == _ELBOW else 4.0


IN_THE_WAY = "something in the way of {}, or its direction, homing offset or zero?"
COMMANDED = "the command is beyond it, or is the homing offset of {} wrong?"
PUSHED = "the commanded effort pushes there, or is the homing offset of {} wrong?"
TOO_FAST = "a command that jumps, gains that are not stable, or a load that came off?"
_YAW, _PITCH, _ROLL, _ELBOW = "left_wrist_yaw", "left_wrist_pitch", "left_wrist_roll", "left_elbow_pitch"
_OFF = {"calibration": {_YAW: 0.18}, "guard": "limit"}
"""The host takes the joint for further out than it is, so that it gets beyond its limits before its stop holds it."""
_SITO = {"robot": "lite_sito"}
"""Wrist pitch and roll then have Sito motors."""
ROWS = {
    "flipped direction": Row(_ELBOW, f"direction of {_ELBOW}, or something that holds it?", direction=1),
    "blocked joint": Row(_YAW, IN_THE_WAY.format(_YAW), blocked=True),
    "blocked joint in LOCOMOTION": Row(_ELBOW, IN_THE_WAY.format(_ELBOW), Mode.LOCOMOTION, blocked=True),
    "wrong homing offset": Row(_YAW, IN_THE_WAY.format(_YAW), calibration={_YAW: -0.6}),
    "wrong zero": Row("right_wrist_yaw", IN_THE_WAY.format("right_wrist_yaw"), zero={"right_wrist_yaw": -0.6}),
    "command beyond the limit": Row(_YAW, f"the command is beyond the limits of {_YAW}", Mode.REMOTE, ask=Ask(-1.7)),
    "beyond the limit by command": Row(_YAW, COMMANDED.format(_YAW), Mode.REMOTE, ask=Ask(-1.9), **_OFF),
    "beyond the limit by effort": Row(
        _YAW, PUSHED.format(_YAW), Mode.REMOTE, ask=Ask(-1.0, effort=-2.0, stiffness=0.0), **_OFF
    ),
    "effort without damping": Row(
        _YAW, TOO_FAST, Mode.REMOTE, ask=Ask(effort=2.0, stiffness=0.0, damping=0.0), guard="speed"
    ),
    "blocked joint, Sito": Row(_PITCH, IN_THE_WAY.format(_PITCH), blocked=True, **_SITO),
    "wrong homing offset, Sito": Row(_PITCH, IN_THE_WAY.format(_PITCH), calibration={_PITCH: -0.6}, **_SITO),
    "wrong zero, Sito": Row(_PITCH, IN_THE_WAY.format(_PITCH), zero={_PITCH: 0.6}, **_SITO),
    "command beyond the limit, Sito": Row(
        _PITCH,
        f"the command is beyond the limits of {_PITCH}",
        Mode.REMOTE,
        ask=Ask(1.0, stiffness=20.0, damping=5.0),
        **_SITO,
    ),
    "beyond the limit by command, Sito": Row(
        _PITCH,
        COMMANDED.format(_PITCH),
        Mode.REMOTE,
        ask=Ask(1.2, stiffness=5.0, damping=5.0),
        calibration={_PITCH: 0.18},
        guard="limit",
        **_SITO,
    ),
    "beyond the limit by effort, Sito": Row(
        _PITCH,
        PUSHED.format(_PITCH),
        Mode.REMOTE,
        ask=Ask(0.3, effort=1.5, stiffness=0.0),
        calibration={_PITCH: 0.18},
        guard="limit",
        **_SITO,
    ),
    "effort with little damping, Sito": Row(
        _ROLL, TOO_FAST, Mode.REMOTE, ask=Ask(effort=1.0, stiffness=0.0, damping=0.2), guard="speed", **_SITO
    ),
}


SAMPLED = {"wrong zero, Sito", "command beyond the limit, Sito", "beyond the limit by effort, Sito"}
"""Rows whose guard another Sito row shows already."""


@pytest.mark.parametrize("name", ROWS)
def test_it_ends_in_damping(name, table, request):
    if name in SAMPLED and not request.config.getoption("--complete"):
        pytest.skip("with --complete")
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


def _taken_for(row):
    lite = quick_lite(row.robot)
    if row.guard == "speed" and row.robot == "lite":
        lite = replace(lite, guards=GuardSettings(speed=SpeedGuard(limit=(SPEEDS["lite"],) * lite.joint_count)))
    if row.direction is None:
        return lite
    joints = [
        replace(joint, motor=replace(joint.motor, direction=row.direction)) if joint.name == row.joint else joint
        for joint in lite.joints
    ]
    return replace(lite, joints=tuple(joints))


def _run(row, slowness):
    """All ticks, and how the machine itself was late."""
    with campaign(
        slowness,
        settings=EmulationSettings(homing_offset=row.zero),
        description=_taken_for(row),
        calibration=row.calibration,
        asks={} if row.ask is None else {row.joint: row.ask},
        robot=row.robot,
    ) as running:
        drive, motors = running.drive, running.motors
        drive.reach(Mode.DAMPING)
        count = len(drive.ticks)
        if row.mode is not Mode.STANDBY:
            drive.run(PERIOD, Intent.LOAD_A)
            drive.run(1.1)
        if row.blocked:
            motors.inject(Fault("blocked", (row.joint,), start=motors.time))
        drive.run(PERIOD, INTENTS[row.mode])
        end = drive.clock() + 2.0
        while drive.clock() < end and not drive.ticks[-1].output.faults:
            drive.run(PERIOD)
        drive.run(AFTERWARDS)
        ticks = drive.ticks[count:]
        longest = max(late.read - early.read for early, late in itertools.pairwise(ticks))
        return ticks, running, f"{longest:.3f} s between ticks" if longest > TOO_LATE else ""


def _judge(row, ticks, running):
    """The checks; for the table the guard, ms from the onset to DAMPING, ms near the effort limit, and torque."""
    joint = running.drive.joints.index(row.joint)
    trip = next((tick for tick in ticks if tick.output.faults), None)
    assert trip is not None, "never noticed"
    assert all(tick.is_ok for tick in ticks), "no motor and no frame complains"
    assert {tick.mode for tick in ticks[: ticks.index(trip)]} >= {row.mode}
    (fault,) = trip.output.faults
    assert fault.message.startswith(f"{row.guard} guard: {row.joint} "), fault.message
    assert fault.message.endswith(row.cause), fault.message
    assert fault.fallback == "damping_controller"
    tail = ticks[ticks.index(trip) :]
    assert {tick.mode for tick in tail} == {Mode.DAMPING}, "in that tick, and nothing recovers by itself"

    harmless = {sent.motor_id for sent in running.sent if sent.time >= trip.read and sent.time <= trip.read + PERIOD}
    later = [sent for sent in running.sent if sent.time >= trip.read]
    assert len(harmless) == len(running.drive.joints), "one for every motor, within the tick"
    assert not any(sent.has_stiffness for sent in later), "and no other after it"
    # A Sito's last frames make it limp.
    assert all(sent.has_damping for sent in later if row.robot == "lite" or sent.time < tail[-1].read)

    onset = next(tick for tick in ticks if _has_begun(row, tick, joint))
    waited = trip.read - onset.read
    pressing = [tick for tick in ticks if abs(tick.effort[joint]) >= 0.8 * row.limit]
    pressed = pressing[-1].read - pressing[0].read if pressing else 0.0
    # A state is a tick old, and a busy machine makes it two.
    assert (pressed if row.guard == "following" else waited) <= TIMES[row.guard] + 6 * PERIOD
    late = [tick for tick in tail if tick.seen >= trip.read + PERIOD + 0.01]
    assert len(late) >= 10
    for tick in late:
        holding = np.abs(tick.effort) - 5.0 * np.abs(tick.velocity)
        assert holding.max() <= SKEW, "DAMPING presses nowhere"
        assert (tick.effort * tick.velocity <= 0.05 * SKEW).all(), "and takes energy away, whatever is wired wrongly"
    most = max(abs(float(tick.effort[joint])) for tick in ticks)
    left = max(abs(float(tick.effort[joint])) for tick in late[-10:])
    near = f"{1e3 * pressed:.0f} over 80 %"
    return f"{row.guard} guard", f"{1e3 * waited:.0f}", near, f"{most:.1f} → {left:.1f}"


def _has_begun(row, tick, joint):
    """Whether what the guard watches for has begun, as far as the robot can tell; of a press half the effort limit."""
    robot = quick_lite(row.robot)
    match row.guard:
        case "limit":
            position = tick.state.joint_position[joint]
            return bool(position > robot.upper[joint] + MARGIN or position < robot.lower[joint] - MARGIN)
        case "speed":
            return bool(abs(tick.velocity[joint]) > SPEEDS[row.robot])
        case _:
            return bool(abs(tick.effort[joint]) >= 0.5 * row.limit)
