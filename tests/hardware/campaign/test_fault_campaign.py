"""Every fault in every mode, on the real adapter, session and supervisor against emulated motors, in real time."""

import itertools
import time
from dataclasses import dataclass, replace

import numpy as np
import pytest
from campaign_rig import Campaign, campaign
from drive_rig import CAN_TIMEOUT, PERIOD, NotReachedError, Tick

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.mock.faults import FAULTS, Fault
from humanoid_sim.messages import Mode, SafetyFlag
from humanoid_sim.robots.description import load_robot

pytestmark = pytest.mark.soak

ELBOW = ("left_elbow_pitch",)
DURATION = 0.5
"""s that a fault lasts."""
AFTERWARDS = 0.3
"""s that are watched after it is over."""
DAMPING = 5.0
"""N·m·s/rad, the Lite's in DAMPING."""
SKEW = 0.3
"""N·m: a snapshot's torque is that of the velocity half a ms before."""
TOO_LATE = 0.035
"""s between two ticks, or two pictures of the motors: nearly one is missing, for no fault of the test's."""
SLOWNESS = (1.0, 2.0, 4.0, 8.0, 16.0)
"""A run in which the machine was late says nothing, and is repeated in slower motion: control period, bus time, motors
and time limits all slower by this factor, so that the same computing takes a smaller part of them."""
MODES = tuple(Mode)


@dataclass(frozen=True)
class Case:
    """A fault and what must come of it."""

    fault: Fault | None
    """None: the control thread stands still."""
    flag: SafetyFlag
    """NONE: it must be tolerated, unless it has a warning."""
    warning: str = ""
    """In the message of a WARNING that has no flag."""
    reaches: bool = True
    """Whether commands still reach the motors; where they do not, only the motors' own timeout stops them."""
    is_sampled: bool = False
    """Whether it runs in LOCOMOTION only, unless all cases are asked for."""
    leaves: bool = True
    """Whether the driver looks at every frame; where it does not, harmless ones must be the first that leave later."""


CASES = {
    "silent": Case(Fault("silent", ELBOW), SafetyFlag.RX_TIMEOUT),
    "some frames lost": Case(Fault("silent", value=0.1), SafetyFlag.NONE),
    "late": Case(Fault("late", ELBOW), SafetyFlag.RX_TIMEOUT),
    "garbage": Case(Fault("garbage", ELBOW), SafetyFlag.INVALID_FRAME),
    "wrong_id": Case(Fault("wrong_id", ELBOW), SafetyFlag.RX_TIMEOUT, reaches=False),
    "power lost": Case(Fault("brown_out", ELBOW, value=3.0), SafetyFlag.RX_TIMEOUT),
    "brown_out": Case(Fault("brown_out", ELBOW), SafetyFlag.MOTOR_FAULT),
    "reset": Case(Fault("reset", ELBOW), SafetyFlag.MOTOR_FAULT),
    "motor_fault": Case(Fault("motor_fault", ELBOW), SafetyFlag.MOTOR_FAULT),
    "over_temperature": Case(Fault("over_temperature", ELBOW), SafetyFlag.TEMPERATURE_LIMIT),
    "encoder_jump": Case(Fault("encoder_jump", ELBOW), SafetyFlag.MOTOR_FAULT),
    "second_master": Case(Fault("second_master"), SafetyFlag.INVALID_FRAME),
    "bus_off": Case(Fault("bus_off"), SafetyFlag.BUS_OFF, reaches=False),
    "tx_full": Case(Fault("tx_full"), SafetyFlag.TX_QUEUE_OVERRUN, reaches=False, leaves=False),
    "host stalls 300 ms": Case(None, SafetyFlag.MOTOR_FAULT),
}
WRIST = ("left_wrist_roll",)
_SILENT = Case(None, SafetyFlag.RX_TIMEOUT)
"""No frame with which a Sito motor tells a fault is known: one that protects itself is silent."""
_OF_A_WRIST = {
    "wrong_id": replace(_SILENT, reaches=False),  # it goes on as it was, because nothing stops it
    "garbage": Case(None, SafetyFlag.INVALID_FRAME),
    "encoder_jump": Case(None, SafetyFlag.MOTOR_FAULT),
}
SITO_CASES = {
    name: replace(_OF_A_WRIST.get(name, _SILENT), fault=replace(case.fault, joints=WRIST))
    if case.fault is not None and case.fault.joints
    else case
    for name, case in CASES.items()
}
ENDLESS = [i for i, joint in enumerate(load_robot("lite_sito").joints) if joint.motor and joint.motor.family == "sito"]
"""Joints whose motors nothing stops where no command reaches them any more."""
SAMPLE = (Mode.LOCOMOTION, Mode.STANDBY, Mode.REMOTE)


def test_every_fault_has_a_case():
    no_flag = {"stuck"}  # only the joints' motion shows it
    assert {case.fault.kind for case in CASES.values() if case.fault is not None} == set(FAULTS) - no_flag


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
@pytest.mark.parametrize("name", CASES)
def test_fault_in_mode(name, mode, table, request):
    if CASES[name].is_sampled and mode is not Mode.LOCOMOTION and not request.config.getoption("--complete"):
        pytest.skip("in LOCOMOTION only, without --complete")
    _find(name, CASES[name], mode, "lite", table)


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
@pytest.mark.parametrize("name", SITO_CASES)
def test_fault_of_a_sito_or_beside_one(name, mode, table, request):
    """On one bus with Robstride motors. Each fault in one mode that moves; all of them with --complete."""
    if not request.config.getoption("--complete") and mode is not SAMPLE[[*SITO_CASES].index(name) % len(SAMPLE)]:
        pytest.skip("a sample without --complete")
    _find(name, SITO_CASES[name], mode, "lite_sito", table)


def _find(name, case, mode, robot, table):
    for slowness in SLOWNESS:
        try:
            course = _run(case, mode, slowness, robot)
        except (NotReachedError, RobotError) as error:
            problem = str(error)
            continue
        problem = course.disturbance
        if not problem:
            endless = ENDLESS if robot == "lite_sito" and not case.reaches else []
            where = name if robot == "lite" else f"{name}, {robot}"
            table.append((where, mode.name, *_judge(case, mode, course, endless), f"{slowness:g}"))
            return
    pytest.fail(f"the machine is too busy even in slow motion: {problem}", pytrace=False)


@dataclass(frozen=True)
class Course:
    """What happened around a fault."""

    began: float
    """s, slow clock."""
    before: list[Tick]
    """The last ticks before it, in which all was well."""
    after: list[Tick]
    """All that follow."""
    campaign: Campaign
    disturbance: str
    """How the machine itself was late, so that this run says nothing; empty: it was not."""


def _run(case, mode, slowness, robot):
    with campaign(slowness, robot=robot) as running:
        drive, motors = running.drive, running.motors
        drive.reach(mode)
        count = len(drive.ticks)
        before, stood_still = drive.ticks[-10:], motors.slipped
        if case.fault is None:
            began = drive.clock()
            time.sleep(0.3 * slowness)
        else:
            began = drive.clock() + 0.007
            motors.inject(replace(case.fault, start=motors.time + 0.007, duration=DURATION))
        drive.run(DURATION + AFTERWARDS)
        after = drive.ticks[count:]
        disturbance = _disturbance(before, after[case.fault is None :])
        if motors.slipped > stood_still:
            disturbance = disturbance or f"the motors stood still for {motors.slipped - stood_still:.3f} s"
        return Course(began, before, after, running, disturbance)


def _disturbance(before, after):
    bad = next((status for tick in before for status in tick.safety if not status.is_ok), None)
    if bad is not None:
        return f"before the fault: {bad.message}"
    longest = max(late.read - early.read for early, late in itertools.pairwise(after))
    blind = max(late.seen - early.seen for early, late in itertools.pairwise(after))
    return f"{longest:.3f} s between ticks, {blind:.3f} s of motors" if max(longest, blind) > TOO_LATE else ""


def _judge(case, mode, course, endless):
    """The checks; flag, detection time, reaction time and torque for the table. `endless` go on as they were."""
    diary = course.campaign.diary
    assert diary.times_of("enabled", course.began) == [], "no motor is enabled without an operator"
    held = max(_holding(tick) for tick in course.before)
    assert held > 0.5 or mode in (Mode.ZERO_TORQUE, Mode.DAMPING), "there is something to fall"
    detected = next((tick for tick in course.after if not tick.is_ok), None)
    if case.flag is SafetyFlag.NONE and not case.warning:
        assert detected is None, detected and detected.safety
        assert _has_happened(case, course), "it was tolerated, not missed"
        assert {tick.mode for tick in course.after} == {mode}
        return "none: tolerated", "", "", f"{held:.1f}"

    assert detected is not None, "never noticed"
    assert case.flag in detected.flags, detected.safety
    if case.warning:
        assert detected.flags is SafetyFlag.NONE, detected.safety
        assert any(case.warning in status.message for status in detected.safety), detected.safety
    harmless = Mode.ZERO_TORQUE if mode is Mode.ZERO_TORQUE else Mode.DAMPING
    tail = course.after[course.after.index(detected) :]
    assert {tick.mode for tick in tail} == {harmless}, "from this tick on, and nothing recovers by itself"

    since = detected.read
    if not case.leaves:
        since = max(since, next(when for when, text in diary.lines if text.startswith("fault over")))
    reaction = _reaction(course.campaign, detected, since, harmless, is_jammed=not case.leaves)
    assert reaction <= PERIOD

    settled = detected.read + PERIOD + 0.01 + (0.0 if case.reaches else CAN_TIMEOUT)
    late = [tick for tick in tail if tick.seen >= settled]
    assert len(late) >= 10
    others = [_without(tick, endless) for tick in late]
    left = max(_holding(tick) for tick in others)
    assert left <= SKEW
    for tick in others:
        assert (tick.effort * tick.velocity <= 0.05 * SKEW).all(), "what is left takes energy away"
        assert harmless is Mode.DAMPING or not np.abs(tick.effort).max() > 1e-3
    return (
        "WARNING, no flag" if case.warning else str(case.flag.name),
        f"{1e3 * (detected.read - course.began):.0f}",
        f"{1e3 * reaction:.1f}",
        f"{held:.1f} → {left:.1f}",
    )


def _has_happened(case, course):
    """Whether a fault of the computer's end, or of the bus, has met a frame."""
    return True


def _without(tick, joints):
    """The tick without these joints."""
    return replace(tick, effort=np.delete(tick.effort, joints), velocity=np.delete(tick.velocity, joints))


def _holding(tick):
    """N·m, the largest of the joints' torques beyond what damping alone gives: K_d times the velocity at most."""
    return max(float((np.abs(tick.effort) - DAMPING * np.abs(tick.velocity)).max()), 0.0)


def _reaction(running, detected, since, harmless, *, is_jammed):
    """s from `since` until every motor's harmless command had been handed to the driver; no other may follow."""
    leaving = {}
    last = running.drive.ticks[-1].read  # what follows may be the robot's closing
    written = [sent for sent in running.sent if detected.read <= sent.time < last]
    for sent in written:
        is_harmless = not sent.has_stiffness and sent.has_damping is (harmless is Mode.DAMPING)
        if is_harmless and sent.time >= since:
            leaving.setdefault(sent.motor_id, sent.time)
        assert is_harmless or not leaving or (is_jammed and sent.awaits_gains), (
            "another command after the first harmless one"
        )
    assert len(leaving) == len(running.drive.joints), "one for every motor"
    return max(leaving.values()) - since
