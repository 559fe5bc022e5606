import numpy as np
import pytest

from humanoid_sim.assets import asset_path
from humanoid_sim.controllers.rotation import rotation_angle, rotation_from_6d
from humanoid_sim.evaluation.tracking import peak_speed
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.kinematics import ForwardKinematics
from humanoid_sim.training.held_out import collisions
from humanoid_sim.training.motions import BODIES, POLICY_DT, SAMPLES, joint_frames, pose_a, sample_motion
from humanoid_sim.training.trajectory import derivative

FILES = sorted(asset_path("motions").glob("*.mcap"))


@pytest.fixture(scope="module")
def lite():
    return load_robot("lite")


@pytest.fixture(scope="module", params=sorted(SAMPLES))
def sample(request, lite):
    return (request.param, *sample_motion(lite, request.param))


def test_every_sample_has_its_file():
    assert [file.stem for file in FILES] == sorted(SAMPLES)


def test_the_shipped_file_is_what_the_code_makes(sample):
    name, motion, _ = sample
    shipped = read_motion(asset_path("motions", f"{name}.mcap"))
    assert (shipped.robot, shipped.task_type) == ("lite", "tracking")
    assert shipped.body_names == motion.body_names == BODIES
    assert shipped.policy_dt == POLICY_DT
    np.testing.assert_allclose(shipped.frames, motion.frames, atol=1e-5)


def test_samples_begin_and_end_in_pose_a_at_rest(lite, sample):
    _, motion, path = sample
    np.testing.assert_allclose(path[[0, -1]], np.stack([pose_a(lite)] * 2), atol=1e-6)
    assert np.abs(np.diff(path[:3], axis=0)).max() < 1e-3
    assert np.abs(np.diff(path[-3:], axis=0)).max() < 1e-3
    assert 6.0 <= motion.duration <= 10.0


def test_the_hands_are_fast_enough_to_tell_policies_apart(sample):
    _, motion, _ = sample
    hands = motion.frames[:, : 3 * len(BODIES)].reshape(len(motion.frames), -1, 3)[:, 1::2]
    assert 0.55 <= peak_speed(hands, POLICY_DT) <= 0.9


def test_samples_stay_within_limits_and_touch_nothing(lite, sample):
    _, _, path = sample
    assert (path > lite.lower + 0.1).all()
    assert (path < lite.upper - 0.1).all()
    assert collisions(lite, path[::4]) == set()


def test_samples_are_smooth(sample):
    _, _, path = sample
    velocity = derivative(path, POLICY_DT)
    assert np.abs(velocity).max() < 6.0
    assert np.abs(derivative(velocity, POLICY_DT)).max() < 60.0


def test_frames_are_the_bodies_poses(lite):
    path = np.stack([pose_a(lite), np.zeros(14)])
    frames = joint_frames(lite, path)
    position, rotation = ForwardKinematics(lite, BODIES)(path)
    np.testing.assert_allclose(frames[:, :12].reshape(2, 4, 3), position, atol=1e-6)
    # The zero pose is a T: hands at arm's length on both sides.
    np.testing.assert_allclose(frames[1, 3:6], [0.0, 0.48, 0.39], atol=1e-4)
    np.testing.assert_allclose(frames[1, 9:12], [0.0, -0.48, 0.39], atol=1e-4)
    angle = rotation_angle(rotation_from_6d(frames[:, 12:].astype(float).reshape(2, 4, 6)), rotation)
    assert angle.max() < 1e-5
