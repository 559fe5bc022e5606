"""LitePiano-v0: its reward, its songs, one robot and a batch."""

import gymnasium
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.policy.motion import Motion
from humanoid_sim.robots.description import load_robot

NAME = "humanoid_sim/LitePiano-v0"
ROBOT = load_robot("lite_piano")


def song(*notes, frames=40):
    table = np.zeros((frames, 88), dtype=np.float32)
    for key, start, end in notes:
        table[start:end, key] = 1.0
    return Motion(table, (), 0.02, task_type="piano", robot="lite_piano")


def make(**options):
    return gymnasium.make(NAME, **{"robot": ROBOT, "motion": song((30, 5, 30), (60, 10, 30)), **options})


def test_an_observation_has_the_song_the_keys_and_the_robot():
    env = make(joint_noise=0.0, velocity_noise=0.0)
    observation, info = env.reset(seed=0)
    contract = env.unwrapped.scenario.contract
    ahead = 1 + len(contract.lookahead_steps)
    assert observation.shape == (88 * ahead + 88 + 1 + 3 * 14,)
    goals = observation[: 88 * ahead].reshape(ahead, 88)
    steps = np.array([0, *contract.lookahead_steps])
    assert goals[:, 30].tolist() == [float(5 <= step < 30) for step in steps]
    assert goals[:, 60].tolist() == [float(10 <= step < 30) for step in steps]
    assert not observation[88 * ahead : 88 * ahead + 89].any()  # no key is down, and nothing is played yet
    assert info["frame"] == 0


def test_one_robot_and_a_batch_play_alike():
    single = make()
    vector = gymnasium.make_vec(NAME, num_envs=2, threads=1, robot=ROBOT, motion=song((30, 5, 30), (60, 10, 30)))
    observation, _ = single.reset(seed=4)
    observations, _ = vector.reset(seed=[4, 9])
    np.testing.assert_array_equal(observations[0], observation)
    rng = np.random.default_rng(0)
    touched = False
    for _ in range(30):
        action = rng.normal(0.0, 0.6, (2, 14)).astype(np.float32)
        action[:, [0, 7]] += 0.8  # down onto the keys
        observation, reward, _, _, info = single.step(action[0])
        observations, rewards, _, _, infos = vector.step(action)
        np.testing.assert_allclose(observations[0], observation, atol=1e-6)
        assert rewards[0] == pytest.approx(reward, abs=1e-8)
        assert infos["terms"]["reach"][0] == pytest.approx(info["terms"]["reach"], abs=1e-9)
        touched = touched or single.unwrapped.robot.data.ncon > 0
    assert touched


def test_what_is_rewarded():
    env = make(motion=song((30, 0, 40)), joint_noise=0.0, velocity_noise=0.0).unwrapped
    env.reset(seed=0)
    nothing = np.zeros(14, dtype=np.float32)
    _, _, _, _, info = env.step(nothing)
    terms = {name: value / 0.02 for name, value in info["terms"].items()}
    assert terms["keys_hit"] == 0.0
    assert terms["no_wrong_key"] == 0.5
    assert terms["low_wrist"] == 0.0
    assert 0.0 < terms["reach"] < 0.05
    keys = env.robot.data.qpos[14:]
    keys[[30, 41]] = 0.065, 0.063
    env.robot.data.qvel[14:] = 0.0
    _, _, _, _, info = env.step(nothing)  # they are on their way up, and still down
    terms = {name: value / 0.02 for name, value in info["terms"].items()}
    assert terms["keys_hit"] == 0.0
    assert terms["no_wrong_key"] == 0.5


def test_the_nearer_a_finger_the_better():
    """The finger in its ready pose, then where it touches its key."""
    rewards = []
    for target in (None, (-0.5216, -0.0905, -1.0691, -1.7744, -0.0647, 0.1877, -0.4009)):
        env = make(motion=song((30, 0, 40)), joint_noise=0.0, velocity_noise=0.0).unwrapped
        env.reset(seed=0)
        pose = env.scenario.contract.default_joint_pos.copy()
        if target is not None:
            pose[:7] = target
        action = ((pose - env.scenario.contract.default_joint_pos) / 0.5).astype(np.float32)
        for _ in range(30):
            _, _, _, _, info = env.step(action)
        rewards.append(info["terms"]["reach"] / 0.02)
    assert rewards[0] < 0.01
    assert rewards[1] > 0.1  # of 0.25: the arm sags below it, by the key's spring


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"motion": "tune.mid"}, "tune.mid: no such file"),
        ({"motion": song((2, 0, 9)), "robot": load_robot("lite")}, "policy on robot 'lite': .* 'key_pressed' needs"),
        ({"motion": None}, "motion: is missing"),
    ],
)
def test_what_does_not_fit_is_refused(options, problem):
    with pytest.raises(InputError, match=problem):
        make(**options)
