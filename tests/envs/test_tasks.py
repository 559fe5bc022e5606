"""What tasks reward, what ends an episode, what is commanded, and where episodes begin."""

import numpy as np
import pytest
from alike import BIPED, both, walk_along

from humanoid_sim.envs.config import CONFIGS, PolicyEnvConfig, build_scenario
from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.step_metrics import METRICS
from humanoid_sim.robots.description import load_robot

LEGS = load_robot("lite_biped")


def zeros(env):
    return np.zeros(env.action_space.shape, dtype=np.float32)


@pytest.mark.parametrize("config", CONFIGS)
def test_a_reward_is_the_sum_of_weighted_rows_of_the_table(config):
    env = PolicyEnv(config)
    env.reset(seed=0)
    _, reward, _, _, info = env.step(0.2 * env.action_space.sample())
    assert info["terms"].keys() <= METRICS.keys()
    assert reward == pytest.approx(sum(float(value) for value in info["terms"].values()))


def test_weights_and_functions_of_the_caller():
    def knees(sample):
        return np.abs(sample.state.joint_velocity[..., [3, 10]]).sum(axis=-1)

    options = {"rewards": {"knees": (-0.5, knees), "const": (1.0, lambda _: 2), "alive": 0.0, "rocking": -1.0}}
    native, sync = both(BIPED, 2, **options)
    walk_along(native, sync, 4)
    env = sync.envs[0].unwrapped
    *_, info = env.step(zeros(env))
    terms, speed = info["terms"], np.abs(env.robot.state().joint_velocity[[3, 10]]).sum()
    assert "alive" not in terms
    assert terms["knees"] == pytest.approx(-0.5 * 0.02 * speed)
    assert terms["const"] == pytest.approx(0.02 * 2.0)
    base = env.robot.base
    assert terms["rocking"] == pytest.approx(-0.02 * (base.angular_velocity[:2] ** 2).sum())


def test_a_function_that_gives_no_reward_is_named():
    env = PolicyEnv("lite_tracking", rewards={"mine": (1.0, lambda _: float("nan"))})
    env.reset(seed=0)
    with pytest.raises(InputError, match="rewards: mine is not finite"):
        env.step(zeros(env))


def test_what_terminates_can_be_chosen():
    thrown = {"qvel": np.r_[0.0, 0.0, 0.0, 0.0, 12.0, 0.0, np.zeros(14)]}
    ends = []
    for options in ({}, {"terminations": ()}):
        env = PolicyEnv("biped_velocity", guards=False, **options)
        env.reset(seed=0, options=thrown)
        ends.append(any(env.step(zeros(env))[2] for _ in range(12)))
    assert ends == [True, False]


def test_commands_are_within_the_contract_s_ranges_and_some_stand():
    made = build_scenario(PolicyEnvConfig(policy="lite_biped_velocity", robot=LEGS)).task
    commands = made.commands(np.random.default_rng(0).random((4000, made.command_draws)))
    assert commands.shape == (4000, 4, 3)  # 20 s, each holds for 5 s
    assert (commands == 0.0).all(axis=-1).mean() == pytest.approx(0.1, abs=0.02)
    assert commands.min(axis=(0, 1)).tolist() == pytest.approx([-0.5, -0.4, -0.8], abs=0.01)
    assert commands.max(axis=(0, 1)).tolist() == pytest.approx([0.8, 0.4, 0.8], abs=0.01)
    steps = np.array([0, 249, 250, 999, 5000])
    chosen = made.command(commands[:5], steps)
    np.testing.assert_array_equal(chosen, commands[np.arange(5), [0, 0, 1, 3, 3]])
