import math

import numpy as np
import pytest

from humanoid_sim.assets import asset_path
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.motion import Motion, read_motion
from tools.samples.arm import both_arms
from tools.samples.evaluate import TrackingFailedError, follow, inverse_kinematics_policy
from tools.samples.motions import BODIES, POLICY_DT, joint_frames, pose_a
from tools.samples.random_motions import held_out_motions

pytestmark = pytest.mark.slow  # of the shipped policy, by the metrics that it was trained for

SAMPLES = ("circle", "drum", "reach", "wave")


@pytest.fixture(scope="module")
def checkpoint():
    return load_checkpoint(asset_path("policies", "lite_tracking.onnx"))


def _still(lite, joint_position):
    return Motion(joint_frames(lite, joint_position[None]), BODIES, POLICY_DT, "tracking", "lite")


@pytest.mark.parametrize("name", SAMPLES)
def test_the_shipped_policy_tracks_the_samples_and_beats_inverse_kinematics(lite, checkpoint, name):
    motion = read_motion(asset_path("motions", f"{name}.mcap"))
    contract = checkpoint.contract
    policy = follow(lite, contract, checkpoint.policy, motion)
    baseline = follow(lite, contract, inverse_kinematics_policy(lite, contract, motion), motion)
    hands = policy.summary.hands
    assert policy.summary.samples == len(motion.frames)
    assert hands.position_rms < 0.015
    assert math.degrees(hands.orientation_rms) < 5.0
    assert hands.position_rms < 0.6 * baseline.summary.hands.position_rms
    assert hands.orientation_rms < baseline.summary.hands.orientation_rms
    # Tracking better must not come from shaking: commands change hardly more than the exact joint positions do.
    assert policy.command_rate < 1.3 * baseline.command_rate


def test_it_tracks_motions_of_which_training_knew_nothing(lite, checkpoint):
    for motion in held_out_motions(lite, 3, seed=123):
        hands = follow(lite, checkpoint.contract, checkpoint.policy, motion).summary.hands
        assert hands.position_rms < 0.02
        assert math.degrees(hands.orientation_rms) < 6.0


def test_it_copes_with_late_commands(lite, checkpoint):
    motion = read_motion(asset_path("motions", "reach.mcap"))
    hands = follow(lite, checkpoint.contract, checkpoint.policy, motion, command_delay=0.01).summary.hands
    assert hands.position_rms < 0.02


def test_it_copes_with_the_timing_of_a_bus(lite, checkpoint):
    """At 50 Hz, with states one tick old: the policy must neither lose the motion nor ring."""
    motion = read_motion(asset_path("motions", "reach.mcap"))
    rollout = follow(lite, checkpoint.contract, checkpoint.policy, motion, as_on_bus=True)
    plain = follow(lite, checkpoint.contract, checkpoint.policy, motion)
    assert rollout.summary.hands.position_rms < 0.02
    assert rollout.command_rate < 1.3 * plain.command_rate


@pytest.mark.parametrize("delay", [0.0, 0.01])
def test_it_holds_the_last_frame_still(lite, checkpoint, delay):
    motion = _still(lite, pose_a(lite))
    rollout = follow(lite, checkpoint.contract, checkpoint.policy, motion, extra_time=10.0, command_delay=delay)
    assert np.ptp(rollout.joint_position[-100:], axis=0).max() < 1e-4
    assert rollout.summary.hands.position_max < 0.02  # the sag of standby, at the first frame
    assert np.abs(rollout.joint_position[-1] - pose_a(lite)).max() < 0.01


def test_a_motion_that_starts_elsewhere_is_reached_without_violence(lite, checkpoint):
    away = np.array([-0.3, 0.2, 0.3, 0.35, 0.3, 0.15, -0.2])
    target = pose_a(lite) + both_arms(away, away)
    rollout = follow(lite, checkpoint.contract, checkpoint.policy, _still(lite, target), extra_time=3.0)
    assert rollout.fastest_joint < 9.0
    overshoot = (rollout.joint_position - target) * np.sign(target - pose_a(lite))
    assert overshoot.max() < 0.15
    assert np.abs(rollout.joint_position[-1] - target).max() < 0.02


def test_inverse_kinematics_follows_the_joints_but_sags(lite, checkpoint):
    motion = _still(lite, pose_a(lite))
    contract = checkpoint.contract
    policy = inverse_kinematics_policy(lite, contract, motion)
    np.testing.assert_allclose(policy(np.zeros(78, dtype=np.float32), 0), 0.0, atol=1e-3)
    rollout = follow(lite, contract, policy, motion, extra_time=2.0)
    assert 0.01 < rollout.summary.hands.position_rms < 0.02


def test_a_policy_that_fails_is_reported(lite, checkpoint):
    motion = _still(lite, pose_a(lite))
    with pytest.raises(TrackingFailedError, match="nan"):
        follow(lite, checkpoint.contract, lambda *_: np.full(14, np.nan), motion)
