"""Checkers of Gymnasium and of stable-baselines3 find nothing wrong; every id is there."""

import importlib

import gymnasium
import pytest
from gymnasium.utils.env_checker import check_env

from humanoid_sim.envs import ENVIRONMENTS


@pytest.mark.parametrize("name", ENVIRONMENTS)
@pytest.mark.filterwarnings("ignore:.*symmetric and normalized", "ignore:.*Box observation space m")
def test_gymnasium_finds_nothing_wrong(name):
    env = gymnasium.make(name)
    check_env(env.unwrapped, skip_render_check=True)
    env.close()


@pytest.mark.peers
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_stable_baselines3_finds_nothing_wrong(name):
    checker = importlib.import_module("stable_baselines3.common.env_checker")
    env = gymnasium.make(name)
    checker.check_env(env.unwrapped, warn=False, skip_render_check=True)
    env.close()
