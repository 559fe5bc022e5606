"""Figures of a run that can be worked out by hand."""

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from models import contract_of

from humanoid_sim.controllers.reference import MotionReference, build_reference
from humanoid_sim.evaluation.run_figures import MotionFigures, RunFigures
from humanoid_sim.evaluation.run_report import describe_effort
from humanoid_sim.messages import ControlMode, FaultReport, Mode, SafetyStatus, TickInput, TickOutput, TickRecord
from humanoid_sim.messages import SafetyFlag as Flag
from humanoid_sim.messages import SafetyLevel as Level
from humanoid_sim.mit import ANCHOR_POSE, KEY_PRESSED, Extern, MITCommand, MITState
from humanoid_sim.policy.checkpoint import zero_policy
from humanoid_sim.policy.loaded_policy import LoadedPolicy
from humanoid_sim.policy.motion import body_frames
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.floating_base import BaseState
from humanoid_sim.simulation.kinematics import ForwardKinematics
from humanoid_sim.testing.healthy import healthy_state

BODIES = ("left_elbow_pitch", "left_hand", "right_hand")


@pytest.fixture(scope="module")
def lite():
    return load_robot("lite")


def at(joints):
    return replace(MITState.unknown(len(joints)), joint_position=np.array(joints))


def test_displaced_bodies_and_the_hands_among_them(lite):
    frames = np.repeat(body_frames(*ForwardKinematics(lite, BODIES)(np.zeros((1, 14)))), 2, axis=0)
    frames[0, 3:6] += [0.03, 0.0, 0.04]  # the left hand, 5 cm
    frames[1, 6] += 0.01  # the right hand, 1 cm
    contract = contract_of(lite.joint_names, task_type="tracking", body_names=BODIES, command_names=("motion",))
    errors = MotionFigures(lite, LoadedPolicy(contract, build_reference(contract, frames), zero_policy(14)))
    for frame in (0, 1):
        errors.update(frame, at(np.zeros(14)))
    summary = errors.summary()["tracking"]
    assert summary["samples"] == 2
    bodies, hands = (summary["errors"][name] for name in ("body_position_error", "hand_position_error"))
    assert bodies["rms"] == pytest.approx(math.sqrt((0.05**2 + 0.01**2) / 6), abs=1e-6)  # three bodies, two frames
    assert hands["rms"] == pytest.approx(math.sqrt((0.05**2 + 0.01**2) / 4), abs=1e-6)
    assert hands["mean"] == pytest.approx((0.05 + 0.01) / 2 / math.sqrt(2), abs=1e-6)
    assert hands["max"] == pytest.approx(0.05 / math.sqrt(2), abs=1e-6)
    assert summary["errors"]["hand_orientation_error"]["max"] < 1e-3


REFERENCE = MotionReference(
    2,
    {
        "reference_joint_pos": np.array([[0.1, 0.2], [0.3, 0.4]]),
        "reference_joint_vel": np.zeros((2, 2)),
        "anchor_pos": np.array([[0.0, 0.0, 0.8], [1.0, 0.0, 0.8]]),
        "anchor_quat": np.array([[1.0, 0.0, 0.0, 0.0]] * 2),
    },
)


def test_joints_by_name_and_a_reference_laid_onto_the_robot(lite):
    joints = tuple(msgspec.structs.replace(joint, name=name) for joint, name in zip(lite.joints, "ab", strict=False))
    robot = msgspec.structs.replace(lite, joints=joints)
    contract = contract_of(("b", "a"), task_type="tracking", anchor_body="base", align_reference=True)
    poses = [([0.2, 0.1], (3.0, -1.0, 0.8)), ([0.4, 0.3], (3.0, 0.0, 0.8))]

    def summary(first):
        errors = MotionFigures(robot, LoadedPolicy(contract, REFERENCE, zero_policy(2)))
        for frame, (q, place) in [*enumerate(poses)][first:]:
            pose = np.array([*place, math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)])
            errors.update(frame, replace(at(q), extern={ANCHOR_POSE: Extern(pose, 0.0)}))
        return errors.summary()["tracking"]

    errors = summary(0)["errors"]
    assert [*errors] == ["joint_error", "anchor_position_error", "anchor_orientation_error"]
    assert all(error["max"] == pytest.approx(0.0, abs=1e-6) for error in errors.values())
    assert summary(1) is None, "where its start was not seen, it is not known where the motion lies"


def test_a_song_is_scored_at_each_step_that_was_shown_and_a_rest_is_right(lite):
    """Two of the 88 keys; one character for each step."""
    wanted, pressed = ("##..", "##.."), ("#..#", "##..")

    def keys(rows):
        found = np.zeros((len(rows[0]), 88))
        found[:, [40, 44]] = np.array([[letter == "#" for letter in row] for row in rows]).T
        return found

    contract = contract_of(lite.joint_names, task_type="piano", lookahead_steps=(0,), command_names=())
    song = MotionReference(4, {"target_keys": keys(wanted)})
    figures = MotionFigures(lite, LoadedPolicy(contract, song, zero_policy(14)))
    assert figures.summary() == {"tracking": None, "piano": None}
    for frame, down in enumerate([*keys(pressed), keys(wanted)[3]]):  # the last frame is held, and counts once
        figures.update(min(frame, 3), replace(at(np.zeros(14)), extern={KEY_PRESSED: Extern(down, 0.0)}))
    # precision 1, 1, (0/0 =) 1, 0; recall 1, 1/2, 1, (0/0 =) 1; F1 1, 2/3, 1, 0
    expected = {"precision": 0.75, "recall": 0.875, "f1": (1 + 2 / 3 + 1) / 4}
    assert figures.summary()["piano"] == pytest.approx(expected)


def tick(lite, index, mode=Mode.DAMPING, *, effort=None, safety=(), qpos=None, **output):
    state = healthy_state([0.0] * lite.joint_count, time=0.5 * index)
    state = replace(state, joint_effort=np.zeros(lite.joint_count) if effort is None else effort)
    control = ControlMode(mode, mode.name.lower(), f"reason {index}")
    result = replace(TickOutput(MITCommand.zeros(lite.joint_count), control), **output)
    return TickRecord(index, TickInput(state, safety), result, 1e-4 * (index + 1), False, qpos)


def figures(lite, *ticks):
    found = RunFigures(lite)
    for one in ticks:
        assert found.tick(one) == ""
    return found.summary()


def test_modes_faults_refusals_and_changes_of_safety_with_their_times(lite):
    fault = FaultReport("rl_policy_controller", "damping_controller", "action is nan")
    warning = SafetyStatus(Level.WARNING, Flag.INVALID_FRAME, "can1")
    found = figures(
        lite,
        tick(lite, 0, Mode.ZERO_TORQUE),
        tick(lite, 1, faults=(fault,)),
        tick(lite, 2, refusals=("LOAD_A refused", "LOAD_B refused")),
        *(tick(lite, i, Mode.STANDBY, safety=(warning,)) for i in (3, 4)),
        tick(lite, 5),
        tick(lite, 6, safety=(warning,)),
    )
    assert [(one["mode"], one["start"], one["end"], one["reason"]) for one in found["modes"]] == [
        ("ZERO_TORQUE", 0.0, 0.0, "reason 0"),
        ("DAMPING", 0.5, 1.0, "reason 1"),
        ("STANDBY", 1.5, 2.0, "reason 3"),
        ("DAMPING", 2.5, 3.0, "reason 5"),
    ]
    shown = {kind: [(one["time"], one["message"]) for one in found[kind]] for kind in ("faults", "refusals", "safety")}
    assert shown == {
        "faults": [(0.5, "rl_policy_controller: action is nan")],
        "refusals": [(1.0, "LOAD_A refused"), (1.0, "LOAD_B refused")],
        "safety": [(time, "safety WARNING INVALID_FRAME from can1") for time in (1.5, 3.0)],
    }
    assert found["tick_time"] == pytest.approx({"median": 4e-4, "p99": 7e-4, "max": 7e-4}, rel=0.02)


def test_the_joint_closest_to_its_limit_comes_first_and_what_is_no_number_does_not_count(lite):
    effort = np.zeros(lite.joint_count)
    effort[2], effort[5] = -0.5 * lite.effort_limit[2], np.nan
    first, *_ = figures(lite, tick(lite, 0, effort=effort), tick(lite, 1))["effort"]
    limit = lite.effort_limit[2]
    assert first == {"joint": lite.joint_names[2], "peak": 0.5 * limit, "limit": limit}
    assert describe_effort([first]) == f"{0.5 * limit:.1f} of {limit:g} N·m at {lite.joint_names[2]}"


class FakeBase:
    """An upright base whose speed forward is the first number of qpos."""

    def standing_height(self, qpos):
        return 0.56

    def sensed(self, state, qpos):
        velocity, rate, place = np.array([qpos[0], 0.0, 0.0]), np.array([0.0, 0.0, 0.3]), np.array([0.0, 0.0, 0.56])
        return BaseState(place, np.array([1.0, 0.0, 0.0, 0.0]), velocity, rate, place, np.zeros(()))


def test_the_mean_velocity_is_that_from_two_seconds_after_release_on(lite):
    found = RunFigures(lite, base=FakeBase())
    for i, speed in enumerate([9.0] * 4 + [0.5] * 3):
        assert found.tick(tick(lite, i, Mode.LOCOMOTION, qpos=np.array([speed]))) == ""
    expected = {"released": 0.0, "velocity": pytest.approx([0.5, 0.0, 0.3]), "fall": None, "fell": ""}
    assert found.summary()["base"] == expected
