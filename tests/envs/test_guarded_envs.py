"""The guards of the control stack in the environments: one robot or many, the same end in the same step."""

import numpy as np

from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.envs.vector_env import PolicyVectorEnv

ARMS = {"contract": "lite_tracking", "robot": "lite", "motion": "wave"}
ROLL = "left_wrist_roll"
STILL = {"joint_noise": 0.0, "velocity_noise": 0.0}


def pressing(env, step):
    """Actions that lead a wrist into its stop and beyond, within 15 steps: shape (m,)."""
    contract = env.scenario.contract
    i = contract.action_joint_names.index(ROLL)
    start = contract.default_joint_pos[contract.joint_names.index(ROLL)]
    action = np.zeros(len(contract.action_joint_names), dtype=np.float32)
    action[i] = min(step / 15, 1.0) * (0.9 - start) / np.broadcast_to(contract.action_scale, action.shape)[i]
    return action


def run(env, steps):
    """How many steps the episode took, and the last one's info."""
    env.reset(seed=3)
    for step in range(1, steps + 1):
        _, _, terminated, _, info = env.step(pressing(env, step))
        if terminated:
            return step, info
    return steps, info


def test_a_joint_that_is_pressed_into_its_stop_ends_the_episode():
    env = PolicyEnv(**ARMS, **STILL)
    steps, info = run(env, 60)
    assert info["fault"].startswith(f"following guard: {ROLL} does not follow: it is at 0.7")
    assert 15 <= steps <= 30
    assert info["terms"] == {}


def test_many_robots_end_as_each_by_itself():
    """The second of three is pressed; the others stay, and it is watched afresh in its next episode."""
    one = PolicyEnv(**ARMS, **STILL)
    steps, info = run(one, 60)
    many = PolicyVectorEnv(3, **ARMS, **STILL, threads=1)
    many.reset(seed=[1, 3, 5])
    actions = np.zeros((3, 14), dtype=np.float32)
    for step in range(1, 2 * steps + 2):
        actions[1] = pressing(many, step if step <= steps else step - steps - 1)
        _, reward, terminated, _, infos = many.step(actions)
        ends = step in (steps, 2 * steps + 1)  # in between is the step in which its next episode begins
        assert terminated.tolist() == [False, ends, False], step
        if ends:
            assert infos["fault"][1] == info["fault"]
            assert reward[1] == 0.0
