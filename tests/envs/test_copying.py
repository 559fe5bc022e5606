"""Environments copied in the middle of an episode, here or to another process: both go on alike, and apart."""

import copy
import pickle
import subprocess
import sys

import cloudpickle
import gymnasium
import numpy as np
import pytest
from alike import EVERYTHING, FIELD, growing, same

import humanoid_sim  # noqa: F401 - registers the environments
from humanoid_sim.envs import dm
from humanoid_sim.envs.lerobot import hub_entry
from humanoid_sim.envs.spaces import INTENTS
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent
from humanoid_sim.robots.description import load_robot

COPIES = {"deepcopy": copy.deepcopy, "pickle": lambda env: pickle.loads(pickle.dumps(env))}
ROBOTS = {"LiteTracking": load_robot("lite"), "BipedVelocity": load_robot("lite_biped")}


copies = pytest.mark.parametrize("how", list(COPIES))


def actions(space, count):
    space.seed(7)
    return [0.1 * space.sample() for _ in range(count)]


@copies
@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("LiteTracking", {}),
        ("LiteTracking", {"actuation": "qfrc_applied", "command_delay": 0.03, "state_delay": 0.01}),
        ("LiteTracking", {"command_delay": 0.005, "state_sampling": "on_command"}),
        ("LiteTracking", {"motion": ["wave", "circle"], "reference_start": 0.7, "actuation": "implicit"}),
        ("LiteTracking", {"randomisation": EVERYTHING, "curriculum": growing}),
        ("BipedVelocity", {}),
        ("BipedVelocity", {"terrain": FIELD, "actuation": "implicit"}),
    ],
)
def test_one_robot_goes_on_alike(how, name, options):
    env = gymnasium.make(f"humanoid_sim/{name}-v0", robot=ROBOTS[name], **options)
    for wrong in (1.5, "half"):
        with pytest.raises(InputError, match=f"progress: is {wrong!r}, expected a number from 0 to 1"):
            env.unwrapped.progress = wrong
    env.unwrapped.progress = 0.7
    env.reset(seed=3)
    taken = actions(env.action_space, 16)
    for action in taken[:8]:
        env.step(action)
    twin = COPIES[how](env)
    assert twin.spec == env.spec
    assert twin.unwrapped.progress == 0.7
    expected = [env.step(action) for action in taken[8:]]
    found = [twin.step(action) for action in taken[8:]]
    same(tuple(found), tuple(expected))
    same(twin.reset(), env.reset())  # of the next episode, from the same stream
    same(twin.action_space.sample(), env.action_space.sample())
    twin.step(taken[0])
    assert not np.array_equal(twin.unwrapped.robot.qpos, env.unwrapped.robot.qpos)


@copies
def test_before_the_first_reset_and_after_a_fault_it_is_as_the_first(how):
    env = gymnasium.make("humanoid_sim/LiteTracking-v0", robot=ROBOTS["LiteTracking"])
    fresh = COPIES[how](env)
    with pytest.raises(gymnasium.error.ResetNeeded):
        fresh.unwrapped.step(np.zeros(14))
    same(fresh.reset(seed=1), env.reset(seed=1))
    env.step(np.full(14, np.nan, dtype=np.float32))
    assert COPIES[how](env).unwrapped.fault_count == 1
    env.close()
    assert COPIES[how](env.unwrapped).robot.is_closed


@copies
@pytest.mark.parametrize("randomisation", [None, EVERYTHING])
def test_many_robots_go_on_alike(how, randomisation):
    options = {"robot": ROBOTS["LiteTracking"], "randomisation": randomisation, "max_episode_steps": 11}
    envs = gymnasium.make_vec("humanoid_sim/LiteTracking-v0", num_envs=5, threads=1, **options)
    envs.reset(seed=3)
    taken = actions(envs.action_space, 24)
    taken[4][2] = np.nan  # one episode ends before the others
    for action in taken[:8]:
        envs.step(action)
    twin = COPIES[how](envs)
    expected = [envs.step(action) for action in taken[8:]]
    found = [twin.step(action) for action in taken[8:]]
    same(tuple(found), tuple(expected))
    assert sum(step[3].sum() for step in expected) >= 5
    same(twin.reset(), envs.reset())
    assert twin.unwrapped.fault_count == 1


@copies
def test_the_whole_stack_goes_on_alike(how):
    env = gymnasium.make("humanoid_sim/LiteModes-v0", robot=ROBOTS["LiteTracking"], control_frequency=50.0, remote=True)
    env.reset(seed=0)
    nothing = {"intent": 0, "send": 0, "command": np.zeros((5, 14))}

    def ask(intent, send=0):
        return nothing | {"intent": INTENTS.index(intent), "send": send}

    script = [ask(Intent.DAMP), ask(Intent.LOAD_A), *[nothing] * 40, ask(Intent.START_REMOTE, 1), *[nothing] * 10]
    for action in script[:20]:
        env.step(action)
    twin = COPIES[how](env)
    for action in script[20:]:
        same(twin.step(action), env.step(action))


@copies
@pytest.mark.parametrize("flat_observation", [False, True])
def test_dm_control_s_environment_goes_on_alike(how, flat_observation):
    pytest.importorskip("dm_control")
    robot = ROBOTS["LiteTracking"]
    env = dm.load("lite_tracking", seed=2, robot=robot, time_limit=0.3, flat_observation=flat_observation)
    env.reset()
    taken = [np.full(14, 0.01 * i, dtype=np.float32) for i in range(30)]
    for action in taken[:8]:
        env.step(action)
    twin = COPIES[how](env)
    for action in taken[8:]:
        expected, found = env.step(action), twin.step(action)
        same(dict(found.observation), dict(expected.observation))
        assert (found.reward, found.discount, found.step_type) == (
            expected.reward,
            expected.discount,
            expected.step_type,
        )
    np.testing.assert_array_equal(twin.physics.data.qpos, env.physics.data.qpos)


LITE, LEGS = load_robot("lite"), load_robot("lite_biped")

# What another process does: it knows no name of this test, and answers with what it got.
OTHER = """
import sys, cloudpickle
with open(sys.argv[1], "rb") as file:
    envs, actions = cloudpickle.load(file)
results = {name: [env.step(action) for action in actions[name]] for name, env in envs.items()}
with open(sys.argv[2], "wb") as file:
    cloudpickle.dump(results, file)
"""


def local_terms():
    factor = 0.5  # a closure: pickle refuses it
    return {"quiet": (-factor, lambda sample: factor * np.abs(sample.state.joint_velocity).sum(axis=-1))}


def environments():
    tracking, velocity = "humanoid_sim/LiteTracking-v0", "humanoid_sim/BipedVelocity-v0"
    (hub,) = hub_entry(velocity, "walk", robot=LEGS)()[velocity].values()
    return {
        "single": gymnasium.make(tracking, robot=LITE, rewards=local_terms()),
        "walking": gymnasium.make(velocity, robot=LEGS, task="walking"),
        "vector": gymnasium.make_vec(
            velocity,
            num_envs=3,
            threads=1,
            robot=LEGS,
            rewards=local_terms(),
            privileged={"height": lambda sample: sample.base.height[..., None]},
            randomisation={"mass": (0.9, 1.1), "joint_position_noise": 0.01},
        ),
        "stack": gymnasium.make("humanoid_sim/LiteModes-v0", robot=LITE, control_frequency=50.0),
        "dm": dm.load("lite_tracking", seed=2, robot=LITE, rewards=local_terms()),
        "lerobot": hub.envs[0],
    }


def test_another_process_goes_on_alike(tmp_path):
    pytest.importorskip("dm_control")
    envs, actions = environments(), {}
    for name, env in envs.items():
        if name == "dm":
            env.reset()
            actions[name] = [np.full(14, 0.01 * i, dtype=np.float32) for i in range(8)]
        else:
            env.reset(seed=3)
            env.action_space.seed(5)
            sampled = [env.action_space.sample() for _ in range(8)]
            actions[name] = sampled if name == "stack" else [0.1 * sample for sample in sampled]
        for action in actions[name][:4]:
            env.step(action)
    sent, got = tmp_path / "sent", tmp_path / "got"
    following = {name: taken[4:] for name, taken in actions.items()}
    sent.write_bytes(cloudpickle.dumps((envs, following)))
    subprocess.run([sys.executable, "-c", OTHER, str(sent), str(got)], check=True, timeout=180)
    with got.open("rb") as file:
        results = cloudpickle.load(file)
    assert list(results) == list(envs)
    for name, env in envs.items():
        expected = [env.step(action) for action in following[name]]
        for a, b in zip(results[name], expected, strict=True):
            same(tuple(a), tuple(b))
    assert results["vector"][0][4]["terms"]["quiet"].max() < 0.0
    assert results["vector"][0][4]["privileged"].shape == (3, 1)


def test_workers_of_gymnasium_s_own_vector_take_them(tmp_path):
    make = hub_entry("humanoid_sim/LiteTracking-v0", robot=LITE, rewards=local_terms(), render_mode=None)
    (one,) = make(n_envs=2)["humanoid_sim/LiteTracking-v0"].values()
    (other,) = make(n_envs=2, use_async_envs=True)["humanoid_sim/LiteTracking-v0"].values()
    try:
        same(other.reset(seed=[0, 1]), one.reset(seed=[0, 1]))
        action = np.full((2, 14), 0.05, dtype=np.float32)
        same(other.step(action), one.step(action))
    finally:
        one.close()
        other.close()
