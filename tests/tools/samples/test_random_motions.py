from itertools import islice

import numpy as np
import pytest

from humanoid_sim.evaluation.tracking import peak_speed
from humanoid_sim.policy.motion import Motion
from humanoid_sim.robots.description import load_robot
from tools.samples.motions import BODIES, derivative, joint_frames, pose_a
from tools.samples.random_motions import PERIOD, collisions, held_out_motions, random_motions


@pytest.fixture(scope="module")
def paths(arm):
    return list(islice(random_motions(arm, np.random.default_rng(20)), 40))


def test_a_seed_gives_the_same_motions(arm, paths):
    again = list(islice(random_motions(arm, np.random.default_rng(20)), 3))
    for first, second in zip(paths, again, strict=False):
        np.testing.assert_array_equal(first, second)


def test_motions_respect_the_arm(arm, paths):
    for path in paths:
        assert path.shape == (800, 7)
        assert (path > arm.lower).all()
        assert (path < arm.upper).all()
        assert np.abs(derivative(path, PERIOD)).max() <= 8.0


def test_motions_are_of_many_kinds(arm, paths):
    speeds = [peak_speed(arm.poses(path)[0][:, 1:], PERIOD) for path in paths]
    assert min(speeds) < 0.4
    assert max(speeds) > 1.0
    from_home = [np.abs(path[0] - arm.home).max() < 1e-3 for path in paths]
    assert 0.2 < np.mean(from_home) < 0.9
    spread = np.ptp(np.concatenate(paths), axis=0) / (arm.upper - arm.lower)
    assert (spread > 0.8).all()


def test_held_out_motions_start_in_pose_a_and_are_fast_and_free():
    lite = load_robot("lite")
    motions = held_out_motions(lite, 3, seed=0)
    home = joint_frames(lite, pose_a(lite)[None])[0]
    assert len(motions) == 3
    for motion in motions:
        assert isinstance(motion, Motion)
        np.testing.assert_allclose(motion.frames[0], home, atol=1e-3)
        hands = motion.frames[:, :12].reshape(-1, len(BODIES), 3)[:, 1::2]
        assert peak_speed(hands, motion.policy_dt) >= 0.5
    assert not np.array_equal(motions[0].frames, held_out_motions(lite, 1, seed=1)[0].frames)


def test_hands_in_each_other_are_a_collision():
    lite = load_robot("lite")
    crossed = pose_a(lite)
    # Both forearms swung inwards until the hands meet in front of the chest.
    crossed[[2, 9]] = [-1.2, 1.2]
    assert collisions(lite, np.stack([pose_a(lite), crossed]))
    assert collisions(lite, pose_a(lite)[None]) == set()
