"""Environments go to another process in the middle of an episode, with functions that only cloudpickle can carry."""

import subprocess
import sys

import cloudpickle
import gymnasium
import numpy as np
import pytest
from alike import same

import humanoid_sim  # noqa: F401 - registers the environments
from humanoid_sim.envs import dm
from humanoid_sim.envs.lerobot import hub_entry
from humanoid_sim.robots.description import load_robot

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
