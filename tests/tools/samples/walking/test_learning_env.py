"""How robots are pushed while they learn to walk."""

from contextlib import contextmanager

import numpy as np
import pytest

from humanoid_sim.envs.vector_env import PolicyVectorEnv

pytest.importorskip("stable_baselines3")

from tools.samples.walking.learning_env import LearningEnv
from tools.samples.walking.stages import CONTRACT, Stage

ALWAYS = 0.02
"""s between two pushes: one in every policy step."""


@contextmanager
def learning(robots, **options):
    envs = PolicyVectorEnv(
        robots, CONTRACT, "lite_biped", task="walking", actuation="implicit", autoreset_mode="SameStep", threads=1
    )
    env = LearningEnv(envs, Stage("any", 0, push_interval=ALWAYS, **options), seed=1)
    env.seed(0)
    env.reset()
    yield env, envs
    env.close()


def forces(envs):
    return np.linalg.norm(envs.wrench[:, :2], axis=1)


def test_a_velocity_push_changes_the_velocity_and_a_force_push_acts_for_a_tenth_of_a_second():
    with learning(8, push=0.0, velocity_push=0.5) as (env, envs):
        before = envs.simulation.qvel.copy()
        env._pushes()
        change = np.linalg.norm(envs.simulation.qvel[:, :2] - before[:, :2], axis=1)
        assert ((change > 0.0) & (change < 0.5)).all()
        np.testing.assert_array_equal(envs.simulation.qvel[:, 2:], before[:, 2:])
        assert not forces(envs).any()
    with learning(8, push=0.4, velocity_push=0.0) as (env, envs):
        before = envs.simulation.qvel.copy()
        pushed = []
        for _ in range(6):
            env._pushes()
            pushed.append(forces(envs).copy())
        assert (pushed[0] > 0.0).all()
        assert (pushed[0] < 11.48 * 0.4 / 0.1).all()
        for each in pushed[1:5]:
            np.testing.assert_array_equal(each, pushed[0])
        assert (pushed[5] != pushed[0]).all()  # the next one
        np.testing.assert_array_equal(envs.simulation.qvel, before)


def test_where_there_are_both_either_comes_half_of_the_time():
    with learning(64, push=0.4, velocity_push=0.5) as (env, envs):
        before = envs.simulation.qvel.copy()
        env._pushes()
        sudden = (envs.simulation.qvel[:, :2] != before[:, :2]).any(axis=1)
        assert 20 < int(sudden.sum()) < 44
        np.testing.assert_array_equal(forces(envs) > 0.0, ~sudden)


def test_nobody_pushes_where_neither_is_asked_for():
    with learning(2, push=0.0, velocity_push=0.0) as (env, envs):
        before = envs.simulation.qvel.copy()
        env._pushes()
        np.testing.assert_array_equal(envs.simulation.qvel, before)
        assert envs.wrench is None
