import math
from dataclasses import replace

import numpy as np
import pytest

from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.evaluation.tracking import AnchorErrors, TrackingErrors
from humanoid_sim.mit import ANCHOR_POSE, Extern, MITState
from humanoid_sim.policy.motion import body_frames
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.kinematics import ForwardKinematics

BODIES = ("left_elbow_pitch", "left_hand", "right_hand")


@pytest.fixture(scope="module")
def lite():
    return load_robot("lite")


def _frames(lite, path):
    return body_frames(*ForwardKinematics(lite, BODIES)(path))


def test_displaced_frames_give_errors_that_a_hand_can_work_out(lite):
    frames = np.repeat(_frames(lite, np.zeros((1, 14))), 2, axis=0)
    frames[0, 3:6] += [0.03, 0.0, 0.04]  # the left hand, 5 cm
    frames[1, 6] += 0.01  # the right hand, 1 cm
    errors = TrackingErrors(lite, frames, BODIES, 0.02)
    errors.update(0, np.zeros(14))
    errors.update(1, np.zeros(14))
    summary = errors.summary()
    elbow, left, right = summary.bodies
    assert [body.name for body in summary.bodies] == list(BODIES)
    assert elbow.position_max == pytest.approx(0.0, abs=1e-12)
    assert left.position_max == pytest.approx(0.05)
    assert left.position_rms == pytest.approx(0.05 / math.sqrt(2))
    assert right.position_rms == pytest.approx(0.01 / math.sqrt(2))
    assert summary.hands.position_rms == pytest.approx(math.sqrt((0.05**2 + 0.01**2) / 4))  # two hands, two frames
    assert summary.hands.position_max == pytest.approx(0.05)
    assert summary.hands.orientation_max == pytest.approx(0.0, abs=1e-6)


def test_a_joint_that_turns_a_hand_in_place_gives_its_angle(lite):
    q = np.zeros(14)
    errors = TrackingErrors(lite, _frames(lite, q[None]), ("left_elbow_pitch", "left_hand", "right_hand"), 0.02)
    q[6] = 0.2  # the wrist's axes meet in the hand's origin
    errors.update(0, q)
    left = errors.summary().bodies[1]
    assert left.orientation_rms == pytest.approx(0.2, abs=1e-6)
    assert left.position_max < 1e-6


def test_errors_end_with_the_motion_however_long_its_last_frame_is_held(lite):
    path = np.zeros((3, 14))
    errors = TrackingErrors(lite, _frames(lite, path), BODIES, 0.02)
    for frame in (0, 1, 2):
        errors.update(frame, path[frame])
    for _ in range(25):
        errors.update(2, np.full(14, 0.5))  # it drifts away, when there is nothing left to follow
    assert errors.summary().samples == 3
    assert errors.summary().hands.position_max < 1e-6
    errors.update(0, np.full(14, 0.5))  # the motion begins again
    assert errors.summary().samples == 4
    assert errors.summary().hands.position_max > 0.01


def test_peak_speed_is_the_reference_hands_and_not_the_elbows(lite):
    frames = np.repeat(_frames(lite, np.zeros((1, 14))), 3, axis=0)
    frames[1:, 0] += 1.0  # the elbow
    frames[2, 6:9] += [0.006, 0.008, 0.0]  # the right hand, 1 cm in one frame
    assert TrackingErrors(lite, frames, BODIES, 0.02).summary().peak_speed == pytest.approx(0.5)


REFERENCE = MotionReference(
    2,
    {
        "reference_joint_pos": np.array([[0.1, 0.2], [0.3, 0.4]]),
        "reference_joint_vel": np.zeros((2, 2)),
        "anchor_pos": np.array([[0.0, 0.0, 0.8], [1.0, 0.0, 0.8]]),
        "anchor_quat": np.array([[1.0, 0.0, 0.0, 0.0]] * 2),
    },
)


def state(joints, position, yaw):
    pose = np.array([*position, math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])
    return replace(MITState.unknown(2), joint_position=np.array(joints), extern={ANCHOR_POSE: Extern(pose, 0.0)})


def test_the_reference_is_laid_onto_the_robot():
    errors = AnchorErrors(REFERENCE, ("b", "a"), ("a", "b"), align=True)
    errors.update(0, state([0.2, 0.1], [3.0, -1.0, 0.8], math.pi / 2))
    errors.update(1, state([0.4, 0.3], [3.0, 0.0, 0.8], math.pi / 2))
    summary = errors.summary()
    assert summary.samples == 2
    for figure in (summary.joint_error, summary.anchor_position, summary.anchor_angle):
        assert figure == pytest.approx((0.0, 0.0), abs=1e-6)


def test_mean_and_greatest_errors():
    errors = AnchorErrors(REFERENCE, ("a", "b"), ("a", "b"), align=False)
    errors.update(0, state([0.1, 0.2], [0.0, 0.0, 0.8], 0.0))
    errors.update(1, state([0.3, 0.8], [1.0, 0.3, 0.4], 0.6))
    summary = errors.summary()
    assert summary.joint_error == pytest.approx((0.1, 0.2), abs=1e-6)
    assert summary.anchor_position == pytest.approx((0.25, 0.5), abs=1e-6)
    assert summary.anchor_angle == pytest.approx((0.3, 0.6), abs=1e-6)
    assert errors.latest == pytest.approx([0.2, 0.5, 0.6], abs=1e-6)


def test_a_motion_that_was_laid_onto_the_robot_unseen_is_not_compared():
    errors = AnchorErrors(REFERENCE, ("a", "b"), ("a", "b"), align=True)
    errors.update(1, state([0.3, 0.4], [1.0, 0.0, 0.8], 0.0))
    assert errors.summary() is None
    assert errors.latest is None
