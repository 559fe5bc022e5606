import numpy as np
import pytest

from humanoid_sim.assets import asset_path
from humanoid_sim.controllers.rotation import rotation_angle, rotation_from_6d
from humanoid_sim.evaluation.tracking import peak_speed
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.simulation.kinematics import ForwardKinematics
from tools.samples import motions
from tools.samples.random_motions import collisions

FILES = sorted(asset_path("motions").glob("*.mcap"))


@pytest.fixture(scope="module", params=sorted(motions.SAMPLES))
def sample(request, lite):
    return (request.param, *motions.sample_motion(lite, request.param))


def test_every_sample_has_its_file():
    assert [file.stem for file in FILES] == sorted(motions.SAMPLES)


def test_the_shipped_file_is_what_the_code_makes(sample):
    name, motion, _ = sample
    shipped = read_motion(asset_path("motions", f"{name}.mcap"))
    assert (shipped.robot, shipped.task_type) == ("lite", "tracking")
    assert shipped.body_names == motion.body_names == motions.BODIES
    assert shipped.policy_dt == motions.POLICY_DT
    np.testing.assert_allclose(shipped.frames, motion.frames, atol=1e-5)


def test_samples_begin_and_end_in_pose_a_at_rest(lite, sample):
    _, motion, path = sample
    np.testing.assert_allclose(path[[0, -1]], np.stack([motions.pose_a(lite)] * 2), atol=1e-6)
    assert np.abs(np.diff(path[:3], axis=0)).max() < 1e-3
    assert np.abs(np.diff(path[-3:], axis=0)).max() < 1e-3
    assert 6.0 <= motion.duration <= 10.0


def test_the_hands_are_fast_enough_to_tell_policies_apart(sample):
    _, motion, _ = sample
    hands = motion.frames[:, : 3 * len(motions.BODIES)].reshape(len(motion.frames), -1, 3)[:, 1::2]
    assert 0.55 <= peak_speed(hands, motions.POLICY_DT) <= 0.9


def test_samples_stay_within_limits_and_touch_nothing(lite, sample):
    _, _, path = sample
    assert (path > lite.lower + 0.1).all()
    assert (path < lite.upper - 0.1).all()
    assert collisions(lite, path[::4]) == set()


def test_samples_are_smooth(sample):
    _, _, path = sample
    velocity = motions.derivative(path, motions.POLICY_DT)
    assert np.abs(velocity).max() < 6.0
    assert np.abs(motions.derivative(velocity, motions.POLICY_DT)).max() < 60.0


def test_frames_are_the_bodies_poses(lite):
    path = np.stack([motions.pose_a(lite), np.zeros(14)])
    frames = motions.joint_frames(lite, path)
    position, rotation = ForwardKinematics(lite, motions.BODIES)(path)
    np.testing.assert_allclose(frames[:, :12].reshape(2, 4, 3), position, atol=1e-6)
    # The zero pose is a T: hands at arm's length on both sides.
    np.testing.assert_allclose(frames[1, 3:6], [0.0, 0.48, 0.39], atol=1e-4)
    np.testing.assert_allclose(frames[1, 9:12], [0.0, -0.48, 0.39], atol=1e-4)
    angle = rotation_angle(rotation_from_6d(frames[:, 12:].astype(float).reshape(2, 4, 6)), rotation)
    assert angle.max() < 1e-5


def test_ease_rises_from_rest_to_rest():
    phase = np.linspace(0.0, 1.0, 1001)
    rise = motions.ease(phase)
    assert (rise[0], rise[500], rise[-1]) == (0.0, 0.5, 1.0)
    speed = motions.derivative(rise[:, None], 1e-3)[:, 0]
    assert abs(speed[0]) < 1e-4
    assert abs(speed[-1]) < 1e-4
    assert speed.max() == pytest.approx(1.875, abs=1e-4)  # Flash and Hogan 1985
    assert motions.ease(np.array([-3.0, 7.0])).tolist() == [0.0, 1.0]


def test_a_path_passes_its_points_at_their_times():
    times, points = np.array([0.0, 0.5, 0.8, 1.6]), np.array([[0.0, 1.0], [1.0, 0.0], [1.0, 0.0], [-1.0, 3.0]])
    path = motions.minimum_jerk_path(times, points, 0.1)
    assert path.shape == (17, 2)
    np.testing.assert_allclose(path[[0, 5, 8, 16]], points, atol=1e-12)
    np.testing.assert_allclose(path[5:9], points[[1] * 4], atol=1e-12)  # the pause


def test_smoothing_keeps_length_mean_and_constants():
    path = np.zeros((50, 2))
    path[25:] = [1.0, 2.0]
    result = motions.smooth(path, 9)
    assert result.shape == path.shape
    np.testing.assert_allclose(result[:20], 0.0)
    np.testing.assert_allclose(result[30:], path[30:])
    assert np.abs(np.diff(result, axis=0)).max() < 0.5
