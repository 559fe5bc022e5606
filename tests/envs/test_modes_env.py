"""The whole stack, driven by intents."""

import gymnasium
import numpy as np
import pytest
from alike import hasty

from humanoid_sim.envs.modes_env import LITE_MODES, ModesEnv, ModesVectorEnv
from humanoid_sim.envs.spaces import INTENTS
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent, Mode, SafetyLevel

MODES = "humanoid_sim/LiteModes-v0"


class Operator:
    """Drives an environment by intents, and checks every observation."""

    def __init__(self, env):
        self.env = env
        self.observation, self.info = env.reset(seed=0)
        self.reward = 0.0

    def request(self, intent=None, ticks=1):
        """An intent in the first of some ticks; the mode after them."""
        for tick in range(ticks):
            number = INTENTS.index(intent) if tick == 0 else 0
            self.observation, reward, self.quit, self.truncated, self.info = self.env.step(number)
            assert self.env.observation_space.contains(self.observation)
            self.reward += reward
        return Mode(self.observation["mode"])


@pytest.fixture(scope="module")
def shared():
    env = ModesEnv(LITE_MODES, robot=hasty())
    yield env
    env.close()


@pytest.fixture
def operator(shared):
    return Operator(shared)


def test_up_to_locomotion_and_down_again(operator):
    assert operator.info["controller"] == "zero_torque_controller"
    assert operator.request(Intent.DAMP) is Mode.DAMPING
    assert operator.request(Intent.LOAD_A, 23) is Mode.STANDBY
    assert operator.observation["standby_segment"] == 2
    assert 0.0 <= operator.observation["standby_progress"][0] < 0.2
    assert operator.request(None, 28) is Mode.STANDBY
    assert operator.observation["standby_finished"] == 1
    assert operator.reward == 0.0
    assert operator.request(Intent.START_LOCOMOTION, 40) is Mode.LOCOMOTION
    assert operator.reward == pytest.approx(0.2)  # 40 ticks of 5 ms
    assert operator.request(Intent.DAMP) is Mode.DAMPING
    assert not operator.quit
    operator.request(Intent.QUIT)
    assert operator.quit
    assert operator.info["time"] == pytest.approx(0.005 * (1 + 51 + 40 + 1 + 1))


def test_refusals_have_reasons(operator):
    assert operator.request(Intent.START_LOCOMOTION) is Mode.ZERO_TORQUE
    assert operator.info["refusals"][0].startswith("START_LOCOMOTION refused: requires finished STANDBY")
    with pytest.raises(InputError, match="action: is 99"):
        operator.env.step(99)


def test_a_simulation_that_breaks_is_let_go_until_the_next_episode(operator):
    operator.request(Intent.DAMP)
    operator.request(Intent.LOAD_A, 10)
    operator.env.robot.data.qvel[3] = np.nan
    assert operator.request(None, 2) is Mode.ZERO_TORQUE  # DAMPING needs the position of at least one joint
    assert operator.observation["safety_level"] == SafetyLevel.CRITICAL
    assert "simulation unstable" in operator.info["status"]
    again = Operator(operator.env)
    assert again.request(Intent.DAMP) is Mode.DAMPING
    assert again.observation["safety_level"] == SafetyLevel.OK


def test_free_standing_legs_are_held_until_a_policy_takes_over():
    env = ModesEnv(robot=hasty("lite_biped"), policy="lite_biped_velocity", motion=None, max_episode_steps=48)
    operator = Operator(env)
    assert env.robot.supported
    operator.request(Intent.DAMP)
    operator.request(Intent.LOAD_A, 45)
    assert env.robot.supported
    assert operator.request(Intent.START_LOCOMOTION) is Mode.LOCOMOTION
    assert not env.robot.supported
    operator.request(Intent.DAMP)
    assert env.robot.supported
    assert operator.truncated


def test_many_do_what_one_does_alone():
    """One quits and begins again, one is up to LOCOMOTION, one is left alone."""
    plans = [[5, 0, 6], [1, 2, *[0] * 50, 4], []]
    options = {"config": LITE_MODES, "robot": hasty(), "max_episode_steps": 60}
    native = gymnasium.make_vec(MODES, 3, vectorization_mode="vector_entry_point", threads=1, **options)
    sync = gymnasium.make_vec(MODES, 3, vectorization_mode="sync", **options)
    ours, theirs = native.reset(seed=0), sync.reset(seed=0)
    for step in range(70):
        actions = np.array([plan[step] if step < len(plan) else 0 for plan in plans])
        ours, theirs = native.step(actions), sync.step(actions)
        for name, values in ours[0].items():
            np.testing.assert_allclose(values, theirs[0][name], rtol=0, atol=1e-6, err_msg=name)
        for i in range(1, 4):
            np.testing.assert_array_equal(ours[i], theirs[i])
        for name in ("controller", "status", "refusals", "faults"):
            assert list(ours[4][name]) == list(theirs[4][name])
        np.testing.assert_allclose(ours[4]["time"], theirs[4]["time"])
    assert ours[0]["mode"].tolist() == [0, 0, 0]
    with pytest.raises(InputError, match="actions: are "):
        native.step(np.array([0, 0, 99]))
    with pytest.raises(InputError, match="robot: 'lite_biped' floats"):
        ModesVectorEnv(2, robot="lite_biped", policy=None)
    native.close()
    sync.close()
