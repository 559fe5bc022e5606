import numpy as np
import pytest
from alike import both, walk_along

from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.envs.scenario import make_scenario
from humanoid_sim.errors import InputError

BIPED = {"contract": "lite_biped_velocity", "robot": "lite_biped", "task": "walking"}


def test_a_batch_is_rewarded_as_single_robots_are():
    native, sync = both("humanoid_sim/BipedVelocity-v0", 3, task="walking", actuation="implicit")
    walk_along(native, sync, 12, 0.4)
    action = np.zeros(native.action_space.shape, dtype=np.float32)
    assert set(native.step(action)[4]["terms"]) == set(sync.step(action)[4]["terms"])


def test_a_robot_that_stands_as_asked_earns_all_there_is():
    env = PolicyEnv(**BIPED, joint_noise=0.0, velocity_noise=0.0, actuation="implicit")
    env.reset(seed=0, options={"command": (0.0, 0.0, 0.0)})
    for _ in range(10):
        _, _, _, _, info = env.step(np.zeros(14, dtype=np.float32))
    earned = {term: 50.0 * value for term, value in info["terms"].items()}
    assert earned["linear_velocity"] == pytest.approx(4.0, abs=0.4)
    assert earned["yaw_rate"] == pytest.approx(2.0, abs=0.1)
    assert earned["foot_height"] == pytest.approx(1.5, abs=0.05)
    assert earned["foot_slide"] == pytest.approx(0.0, abs=0.01)
    assert earned["foot_tilt"] == pytest.approx(0.0, abs=0.01)
    assert earned["alive"] == pytest.approx(0.5)


def test_a_foot_that_stays_down_in_its_swing_earns_less():
    env = PolicyEnv(**BIPED, joint_noise=0.0, velocity_noise=0.0, actuation="implicit")
    env.reset(seed=0, options={"command": (0.3, 0.0, 0.0)})
    heights = []
    for _ in range(8):  # a quarter of the cycle: the left foot should be at its highest
        _, _, _, _, info = env.step(np.zeros(14, dtype=np.float32))
        heights.append(50.0 * info["terms"]["foot_height"])
    assert heights[0] > 1.1
    assert heights[-1] < 0.9


def test_a_quarter_of_the_components_and_of_the_commands_are_zero():
    task = make_scenario(**BIPED).task
    numbers = np.random.default_rng(0).random((4000, task.draws))
    commands = task.start(numbers).commands[:, 0]
    standing = (commands == 0.0).all(axis=1)
    assert 0.24 < standing.mean() < 0.29
    assert 0.41 < (commands[:, 0] == 0.0).mean() < 0.47
    assert commands.min(axis=0).tolist() == pytest.approx([-0.5, -0.4, -0.8], abs=0.01)
    assert commands.max(axis=0).tolist() == pytest.approx([0.8, 0.4, 0.8], abs=0.01)


def test_robots_without_a_clock_or_two_feet_are_refused():
    with pytest.raises(InputError, match="has a fixed base, expected a floating one"):
        make_scenario("lite_tracking", "lite", "wave", task="walking")
