"""What a critic sees: the true state, the same from a single environment and a vector of them."""

import gymnasium
import numpy as np
import pytest

import humanoid_sim  # noqa: F401 - registers the environments
from humanoid_sim.envs.privileged import PRIVILEGED_TERMS
from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot

BIPED, LITE = load_robot("lite_biped"), load_robot("lite")
VELOCITY, TRACKING = "humanoid_sim/BipedVelocity-v0", "humanoid_sim/LiteTracking-v0"


def test_a_vector_sees_what_its_environments_see_through_ends_and_starts():
    vector = gymnasium.make_vec(VELOCITY, num_envs=2, robot=BIPED, privileged=tuple(PRIVILEGED_TERMS), threads=1)
    singles = [gymnasium.make(VELOCITY, robot=BIPED, privileged=tuple(PRIVILEGED_TERMS)) for _ in range(2)]
    _, info = vector.reset(seed=3)
    for i, single in enumerate(singles):
        np.testing.assert_array_equal(single.reset(seed=3 + i)[1]["privileged"], info["privileged"][i])
    rng, over, ends = np.random.default_rng(0), [False, False], 0
    for _ in range(120):
        actions = rng.normal(0.0, 1.0, vector.action_space.shape).astype(np.float32)
        info = vector.step(actions)[4]
        assert info["_privileged"].all()
        for i, single in enumerate(singles):
            if over[i]:
                single_info, over[i] = single.reset()[1], False
            else:
                *_, terminated, truncated, single_info = single.step(actions[i])
                over[i] = terminated or truncated
                ends += over[i]
            np.testing.assert_allclose(info["privileged"][i], single_info["privileged"], atol=1e-6)
    assert ends == 3


def test_it_is_the_truth_of_a_step():
    env = gymnasium.make(VELOCITY, robot=BIPED, privileged=["base_height", "base_gravity", "velocity_command"])
    _, info = env.reset(seed=0, options={"command": (0.3, 0.0, -0.2)})
    assert info["privileged"].shape == (7,)
    height, *gravity_and_command = info["privileged"].tolist()
    assert 0.3 < height < 1.2
    np.testing.assert_allclose(gravity_and_command, [0.0, 0.0, -1.0, 0.3, 0.0, -0.2], atol=1e-6)


def test_noise_is_in_the_observation_only():
    noisy = gymnasium.make_vec(
        TRACKING, num_envs=1, robot=LITE, privileged=["joint_position"], randomisation={"joint_position_noise": 0.2}
    )
    exact = gymnasium.make_vec(TRACKING, num_envs=1, robot=LITE, privileged=["joint_position"])
    seen, told = noisy.reset(seed=1)
    expected, truth = exact.reset(seed=1)
    np.testing.assert_array_equal(told["privileged"], truth["privileged"])
    assert np.abs(seen - expected).max() > 0.05


def test_functions_of_ones_own_and_the_last_of_an_episode():
    envs = gymnasium.make_vec(
        TRACKING,
        num_envs=2,
        robot=LITE,
        privileged={"steps": lambda sample: np.asarray(sample.step, dtype=float)[..., None]},
        max_episode_steps=3,
        autoreset_mode="SameStep",
    )
    envs.reset(seed=0)
    seen = [envs.step(np.zeros(envs.action_space.shape, dtype=np.float32))[4] for _ in range(3)]
    assert seen[1]["privileged"].tolist() == [[2.0], [2.0]]
    assert seen[2]["final_info"]["privileged"].tolist() == [[3.0], [3.0]]
    assert seen[2]["privileged"].tolist() == [[0.0], [0.0]]


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        (
            ["base_hight"],
            "privileged: unknown term 'base_hight' (did you mean 'base_height'?); known: joint_position, ",
        ),
        (["base_height"], "privileged: base_height is of a floating base, and the robot's is fixed"),
        ("joint_position", "privileged: is 'joint_position', expected a list of names"),
    ],
)
def test_what_there_is_not_is_refused(terms, message):
    with pytest.raises(InputError) as caught:
        gymnasium.make(TRACKING, robot=LITE, privileged=terms)
    assert message in str(caught.value)
