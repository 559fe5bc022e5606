"""Figures of a run that can be worked out by hand."""

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from models import contract_of

from humanoid_sim.controllers.reference import MotionReference, build_reference
from humanoid_sim.evaluation.run_figures import BaseMotion, JointUse, MotionErrors, describe_effort
from humanoid_sim.mit import ANCHOR_POSE, Extern, MITState
from humanoid_sim.policy.checkpoint import zero_policy
from humanoid_sim.policy.loaded_policy import LoadedPolicy
from humanoid_sim.policy.motion import body_frames
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.floating_base import BaseState
from humanoid_sim.simulation.kinematics import ForwardKinematics
from humanoid_sim.testing import healthy_state

BODIES = ("left_elbow_pitch", "left_hand", "right_hand")


def figure(summary, name):
    return summary["errors"][name]


@pytest.fixture(scope="module")
def lite():
    return load_robot("lite")


def at(joints):
    return replace(MITState.unknown(len(joints)), joint_position=np.array(joints))


def body_errors(lite, frames):
    contract = contract_of(lite.joint_names, task_type="tracking", body_names=BODIES, command_names=("motion",))
    return MotionErrors(lite, LoadedPolicy(contract, build_reference(contract, frames), zero_policy(14)))


def still(lite, count):
    return np.repeat(body_frames(*ForwardKinematics(lite, BODIES)(np.zeros((1, 14)))), count, axis=0)


def test_displaced_bodies_and_the_hands_among_them(lite):
    frames = still(lite, 2)
    frames[0, 3:6] += [0.03, 0.0, 0.04]  # the left hand, 5 cm
    frames[1, 6] += 0.01  # the right hand, 1 cm
    errors = body_errors(lite, frames)
    for frame in (0, 1):
        errors.update(frame, at(np.zeros(14)))
    summary = errors.summary()
    assert summary["samples"] == 2
    bodies, hands = (figure(summary, name) for name in ("body_position_error", "hand_position_error"))
    assert bodies["rms"] == pytest.approx(math.sqrt((0.05**2 + 0.01**2) / 6), abs=1e-6)  # three bodies, two frames
    assert hands["rms"] == pytest.approx(math.sqrt((0.05**2 + 0.01**2) / 4), abs=1e-6)
    assert hands["mean"] == pytest.approx((0.05 + 0.01) / 2 / math.sqrt(2), abs=1e-6)
    assert hands["max"] == pytest.approx(0.05 / math.sqrt(2), abs=1e-6)
    assert figure(summary, "hand_orientation_error")["max"] < 1e-3


def test_a_held_last_frame_counts_once(lite):
    errors = body_errors(lite, still(lite, 3))
    for frame in (0, 1, 2, 2, 2):
        errors.update(frame, at(np.zeros(14) if frame < 2 else np.full(14, 0.1)))
    assert errors.summary()["samples"] == 3


REFERENCE = MotionReference(
    2,
    {
        "reference_joint_pos": np.array([[0.1, 0.2], [0.3, 0.4]]),
        "reference_joint_vel": np.zeros((2, 2)),
        "anchor_pos": np.array([[0.0, 0.0, 0.8], [1.0, 0.0, 0.8]]),
        "anchor_quat": np.array([[1.0, 0.0, 0.0, 0.0]] * 2),
    },
)


def anchor_errors(lite, *, order=("a", "b"), align):
    joints = tuple(msgspec.structs.replace(joint, name=name) for joint, name in zip(lite.joints, "ab", strict=False))
    two = msgspec.structs.replace(lite, joints=joints)
    contract = contract_of(order, task_type="tracking", anchor_body="base", align_reference=align)
    return MotionErrors(two, LoadedPolicy(contract, REFERENCE, zero_policy(2)))


def posed(joints, position, yaw):
    pose = np.array([*position, math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])
    return replace(at(joints), extern={ANCHOR_POSE: Extern(pose, 0.0)})


def test_joints_by_name_and_a_reference_laid_onto_the_robot(lite):
    errors = anchor_errors(lite, order=("b", "a"), align=True)
    errors.update(0, posed([0.2, 0.1], [3.0, -1.0, 0.8], math.pi / 2))
    errors.update(1, posed([0.4, 0.3], [3.0, 0.0, 0.8], math.pi / 2))
    assert all(error["max"] == pytest.approx(0.0, abs=1e-6) for error in errors.summary()["errors"].values())


def test_errors_of_joints_and_anchor(lite):
    errors = anchor_errors(lite, align=False)
    errors.update(0, posed([0.1, 0.2], [0.0, 0.0, 0.8], 0.0))
    errors.update(1, posed([0.3, 0.8], [1.0, 0.3, 0.4], 0.6))
    summary = errors.summary()
    assert figure(summary, "joint_error")["mean"] == pytest.approx(0.2 / math.sqrt(2))
    assert figure(summary, "anchor_position_error")["max"] == pytest.approx(0.5)


def test_a_reference_whose_start_was_not_seen_is_not_compared(lite):
    errors = anchor_errors(lite, align=True)
    errors.update(1, posed([0.3, 0.4], [1.0, 0.0, 0.8], 0.0))
    assert errors.summary() is None


def base(height=0.8, *, yaw=0.0, tilt=0.0, velocity=(0.0, 0.0, 0.0)):
    turn = np.array([math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])
    lean = np.array([math.cos(tilt / 2), 0.0, math.sin(tilt / 2), 0.0])
    quaternion = [turn[0] * lean[0], -turn[3] * lean[2], turn[0] * lean[2], turn[3] * lean[0]]
    position, rate = np.array([0.0, 0.0, height]), np.array([0.0, 0.0, 0.3])
    return BaseState(position, np.array(quaternion), np.array(velocity), rate, 0.7 * position, np.zeros(()))


def released(time=0.0):
    motion = BaseMotion()
    motion.release(time, 0.56)
    return motion


def test_speeds_are_in_the_heading_frame_from_two_seconds_on():
    motion = released(5.0)
    for k in range(301):
        time = 5.0 + 0.01 * k
        velocity = (9.0, 9.0, 0.0) if time < 7.0 - 1e-9 else (-0.2, 0.5, 0.0)
        motion.update(time, base(0.78, yaw=math.pi / 2, velocity=velocity))
    summary = motion.summary()
    assert summary["duration"] == pytest.approx(3.0)
    assert summary["velocity"] == pytest.approx((0.5, 0.2))
    assert summary["yaw_rate"] == pytest.approx(0.3)
    assert summary["fall"] is None


def test_height_counts_from_landing_on_and_tilt_from_two_seconds_on():
    motion = released()
    for time, height, tilt in ((0.0, 0.83, 0.0), (0.1, 0.79, 0.6), (0.2, 0.78, 0.5), (0.3, 0.82, 0.0), (2.5, 0.8, 0.1)):
        motion.update(time, base(height, tilt=tilt))
    summary = motion.summary()
    assert summary["height"] == pytest.approx((0.78, 0.7975, 0.82))
    assert summary["lowest"] == pytest.approx(0.7 * 0.78 / 0.56)
    assert summary["tilt_max"] == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("height", "tilt", "text"),
    [(0.47, 0.0, "fell: its centre of mass sank to 0.33 m, it stood at 0.56 m"), (0.8, 1.01, "fell: tilted by 58°")],
)
def test_a_fall_ends_the_figures(height, tilt, text):
    motion = released(1.0)
    assert motion.update(1.0, base(0.8)) == ""
    assert motion.update(1.5, base(height, tilt=tilt)) == text
    assert motion.update(2.0, base(0.1, velocity=(7.0, 0.0, 0.0))) == ""  # reported once
    summary = motion.summary()
    assert (summary["fall"], summary["fell"], summary["velocity"]) == (0.5, text, None)


def used(limits, upper=(1.0, 1.0, np.inf)):
    use = JointUse(("hip", "knee", "foot"), np.array(limits), -np.array(upper), np.array(upper))
    for position, velocity, effort in (
        ([0.0, 0.5, 9.0], [1.0, -3.0, 0.0], [30.0, -8.0, np.nan]),
        ([-0.5, 0.25, 7.0], [-2.0, 0.0, np.nan], [-40.0, 1.0, 12.5]),
    ):
        values = {"joint_position": position, "joint_velocity": velocity, "joint_effort": effort}
        use.update(replace(healthy_state([0.0] * 3), **{name: np.array(value) for name, value in values.items()}))
    return use


def test_the_greatest_of_each_joint():
    hip, _, foot = used([88.0, 10.0, np.inf]).rows()
    assert hip == {
        **{"joint": "hip", "speed": 2.0, "effort": 40.0, "effort_limit": 88.0},
        **{"lowest": -0.5, "highest": 0.0, "lower": -1.0, "upper": 1.0},
    }
    assert (foot["speed"], foot["effort"], foot["effort_limit"], foot["upper"]) == (0.0, 12.5, None, None)


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ([40.0, 10.0, 50.0], "40.0 of 40 N·m at hip, 1 ticks at an effort limit"),
        ([88.0, 10.0, np.inf], "8.0 of 10 N·m at knee, 0 ticks at an effort limit; NO EFFORT LIMIT KNOWN for 1 joints"),
        ([np.inf] * 3, "40.0 N·m at hip; NO EFFORT LIMIT KNOWN for 3 joints"),
    ],
)
def test_the_joint_closest_to_its_limit_is_named_and_a_missing_limit_is_reported(limits, expected):
    assert describe_effort(used(limits).effort()).startswith(expected)
