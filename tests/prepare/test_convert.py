from dataclasses import replace

import numpy as np
import pytest
from models import contract_of
from motion_samples import BODIES, joint_frames, joint_path, lite, motion_of

from humanoid_sim.controllers.rotation import matrix, rotation_angle
from humanoid_sim.errors import InputError
from humanoid_sim.prepare.convert import FROM_KINEMATICS, FROM_SOURCE, convert, has_rate, layout_of, resample
from humanoid_sim.prepare.skeleton import Skeleton
from humanoid_sim.prepare.source_motion import SourceMotion
from humanoid_sim.robots.description import load_robot

SKELETON = Skeleton(lite())
BASE_TERMS = ("motion_body_pos_b", "motion_body_ori_b", "joint_pos")
ANCHOR_TERMS = ("motion_command", "motion_anchor_pos_b", "motion_anchor_ori_b", "joint_pos")


def contract(**changes):
    joints = tuple(reversed(SKELETON.joints))
    fields = {
        "task_type": "tracking",
        "joint_stiffness": 20.0,
        "joint_damping": 1.0,
        "observation": BASE_TERMS,
        "action_scale": 0.5,
        "body_names": BODIES,
    }
    return contract_of(joints, **fields | changes)


def named(bodies=("chest", *BODIES), **changes):
    return replace(motion_of(bodies), **changes)


NO_BODIES = {"body_names": (), "body_position": None, "body_quaternion": None}


def make(motion, policy):
    return convert(motion, policy, SKELETON)


@pytest.mark.parametrize(
    ("motion", "origin"),
    [
        (named(), FROM_SOURCE),
        (named(BODIES), FROM_KINEMATICS),  # no base to see them from
        (named(("chest", "left_hand")), FROM_KINEMATICS),
        (named(**NO_BODIES), FROM_KINEMATICS),
    ],
)
def test_bodies_in_the_base_frame(motion, origin):
    made, said = make(motion, contract())
    assert (made.layout, made.body_names, made.robot, made.policy_dt) == ("bodies_b", BODIES, "lite", 0.02)
    assert said == origin
    np.testing.assert_allclose(made.frames, joint_frames(lite(), joint_path()), atol=2e-6)


def test_joints_and_bodies_in_the_world():
    motion = named()
    made, said = make(motion, contract(observation=ANCHOR_TERMS, anchor_body="chest", body_names=("chest", *BODIES)))
    assert (made.layout, said, made.joint_names) == ("joints_bodies_w", FROM_SOURCE, tuple(reversed(SKELETON.joints)))
    parts = np.split(made.frames, np.cumsum([14, 14, 15]), axis=1)
    np.testing.assert_allclose(parts[0], motion.joint_position[:, ::-1], atol=1e-6)
    np.testing.assert_allclose(parts[1], motion.joint_velocity[:, ::-1], atol=1e-6)
    np.testing.assert_allclose(parts[2], motion.body_position.reshape(40, -1), atol=1e-6)
    np.testing.assert_allclose(parts[3], motion.body_quaternion.reshape(40, -1), atol=1e-6)


def test_written_quaternions_keep_their_sign():
    motion = named()
    flips = np.where(np.random.default_rng(0).random((40, 5, 1)) < 0.3, -1.0, 1.0)
    flips[0] = 1.0
    policy = contract(observation=ANCHOR_TERMS, anchor_body="chest", body_names=("chest", *BODIES))
    made, _ = make(replace(motion, body_quaternion=flips * motion.body_quaternion), policy)
    written = made.frames[:, 28 + 15 :].reshape(40, 5, 4)
    assert (flips[1:] * flips[:-1] < 0.0).sum() == 67
    assert (written[1:] * written[:-1]).sum(axis=-1).min() > 0.99
    np.testing.assert_allclose(written, make(motion, policy)[0].frames[:, 43:].reshape(40, 5, 4), atol=1e-6)


@pytest.mark.parametrize("has_base", [True, False])
def test_world_poses_from_joints_alone(has_base):
    motion = named()
    reduced = replace(motion, **NO_BODIES, joint_velocity=None)
    if not has_base:
        reduced = replace(reduced, base_position=None, base_quaternion=None)
    policy = contract(observation=ANCHOR_TERMS, anchor_body="left_hand", body_names=())
    made, said = make(reduced, policy)
    assert (said, made.body_names) == (FROM_KINEMATICS, ("left_hand",))
    np.testing.assert_allclose(made.frames[:, 14:28], motion.joint_velocity[:, ::-1], atol=1e-4)
    position, quaternion = made.frames[:, 28:31], made.frames[:, 31:]
    if has_base:
        np.testing.assert_allclose(position, motion.body_position[:, 2], atol=1e-6)
        assert rotation_angle(matrix(quaternion), matrix(motion.body_quaternion[:, 2])).max() < 1e-5
    else:  # the base stands where the robot's model has it
        place, _ = SKELETON.poses(joint_path(), ("left_hand",))
        np.testing.assert_allclose(position, place[:, 0] + SKELETON.base_position, atol=1e-5)


def test_what_a_motion_lacks():
    with pytest.raises(InputError, match="holds no joint positions, which the policy's reference needs"):
        make(named(joint_position=None), contract(observation=ANCHOR_TERMS))
    with pytest.raises(InputError, match="its bodies lack left_elbow_pitch, right_elbow_pitch"):
        make(named(("chest", "left_hand", "right_hand"), joint_position=None), contract())


def test_a_floating_robot_needs_its_base():
    biped = load_robot("lite_biped")
    skeleton = Skeleton(biped)
    joints = biped.joint_names
    policy = contract(
        joint_names=joints, action_joint_names=joints, observation=ANCHOR_TERMS, body_names=(skeleton.base,)
    )
    motion = SourceMotion("walk.csv", "csv", 50.0, np.zeros((3, len(joints))))
    with pytest.raises(InputError, match=f"no pose of the floating base '{skeleton.base}'"):
        convert(motion, policy, skeleton)


def test_the_layout_follows_the_terms():
    assert layout_of(contract()) == "bodies_b"
    assert layout_of(contract(observation=ANCHOR_TERMS)) == "joints_bodies_w"


def turning(count, fps):
    """One joint that rises by 1 rad/s, one body that turns by 1 rad/s about the vertical and moves by 2 m/s."""
    t = np.arange(count) / fps
    turn = np.stack([np.cos(t / 2), 0 * t, 0 * t, np.sin(t / 2)], axis=-1)
    return SourceMotion(
        source="turn.npz",
        kind="npz",
        fps=fps,
        joint_position=t[:, None],
        joint_velocity=np.ones((count, 1)),
        body_names=("hand",),
        body_position=np.stack([2 * t, 0 * t, 0 * t], axis=-1)[:, None],
        body_quaternion=turn[:, None],
        base_quaternion=turn,
    )


@pytest.mark.parametrize(("count", "fps", "frames"), [(31, 30.0, 51), (121, 120.0, 51), (1, 30.0, 1), (2, 30.0, 2)])
def test_resampling_to_50_hz(count, fps, frames):
    result = resample(turning(count, fps), 0.02)
    expected = turning(frames, 50.0)
    assert result.fps == 50.0
    assert result.joint_position.shape == (frames, 1)
    for name in ("joint_position", "joint_velocity", "body_position", "body_quaternion", "base_quaternion"):
        np.testing.assert_allclose(getattr(result, name), getattr(expected, name), atol=1e-9, err_msg=name)
    assert result.base_position is None


def test_it_never_goes_beyond_the_last_frame():
    result = resample(turning(10, 29.97), 0.02)
    assert 9 / 29.97 - 0.02 < result.joint_position[-1, 0] <= 9 / 29.97


def test_equal_rates():
    assert has_rate(50.0, 0.02)
    assert has_rate(50.0, 0.019999999552965164)  # float32 0.02
    assert not has_rate(49.9, 0.02)
    assert not has_rate(30.0, 0.02)
