"""The tasks through `dm_control`, against the Gymnasium environments that they are."""

import importlib
import os
import shutil
import subprocess
import sys
import unittest
from types import ModuleType

import gymnasium
import numpy as np
import pytest
from alike import EVERYTHING

from humanoid_sim.envs import dm
from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.robots.description import load_robot

dm_env = pytest.importorskip("dm_env")
test_utils = pytest.importorskip("dm_env.test_utils")

ROBOTS = {
    name: load_robot(robot)
    for name, robot in (("lite_tracking", "lite"), ("biped_velocity", "lite_biped"), ("lite_piano", "lite_piano"))
}


def load(name, **options):
    return dm.load(name, robot=ROBOTS[name], **options)


def flat(step):
    return np.concatenate(list(step.observation.values()))


@pytest.mark.parametrize(
    ("name", "options"), [*((name, {}) for name in ROBOTS), ("lite_tracking", {"randomisation": EVERYTHING})]
)
def test_episodes_are_those_of_the_gymnasium_environment(name, options):
    ours = load(name, seed=3, **options)
    theirs = gymnasium.make(dm.NAMES[name], robot=ROBOTS[name], **options)
    single = theirs.unwrapped
    assert isinstance(single, PolicyEnv)
    observation, _ = theirs.reset(seed=3)
    np.testing.assert_array_equal(flat(ours.reset()), observation)
    theirs.action_space.seed(0)
    for _ in range(12):
        action = 0.5 * theirs.action_space.sample()
        step = ours.step(action)
        observation, reward, terminated, truncated, _ = theirs.step(action)
        np.testing.assert_array_equal(flat(step), observation)
        assert step.reward == reward
        assert step.last() == (terminated or truncated)
        np.testing.assert_array_equal(ours.physics.data.qpos, single.robot.qpos)
        if step.last():
            observation, _ = theirs.reset()
            step = ours.step(action)  # which starts the next episode
            assert step.first()
            assert step.reward is None
            np.testing.assert_array_equal(flat(step), observation)


def test_how_episodes_end():
    failing = load("lite_tracking", seed=0)
    failing.reset()
    step = failing.step(np.full(14, np.nan))
    assert step.last()
    assert (step.reward, step.discount) == (0.0, 0.0)

    timed = load("lite_tracking", seed=0, time_limit=0.06)
    timed.reset()
    steps = [timed.step(np.zeros(14)) for _ in range(3)]
    assert [step.last() for step in steps] == [False, False, True]
    assert [step.discount for step in steps] == [1.0, 1.0, 1.0]

    balancing = load("lite_tracking", seed=0, task="balance", episode_seconds=0.04)
    balancing.reset()
    assert balancing.step(np.zeros(14)).discount == 1.0
    step = balancing.step(np.zeros(14))
    assert step.last()
    assert step.discount == 1.0


class TestContract(test_utils.EnvironmentTestMixin, unittest.TestCase):
    """`dm_env`'s own checks of an environment."""

    def make_object_under_test(self):
        return load("lite_tracking", seed=0, episode_seconds=0.1, task="balance")

    def make_action_sequence(self):
        spec = self.environment.action_spec()
        generator = np.random.default_rng(0)
        for _ in range(20):
            yield generator.uniform(0.1 * spec.minimum, 0.1 * spec.maximum).astype(np.float32)


def test_the_viewer_s_loop_runs_it(monkeypatch):
    """What `dm_control.viewer.launch` does in its window: resets, steps, and mouse perturbations between them."""
    ours = load("lite_tracking", seed=0)
    # The loop needs no OpenGL, but is only to be had with its window, which does.
    monkeypatch.setitem(sys.modules, "dm_control.viewer.gui", ModuleType("gui"))
    runtime_module = importlib.import_module("dm_control.viewer.runtime")
    runtime = runtime_module.Runtime(ours, lambda _: np.zeros(14, dtype=np.float32))
    errors = []
    runtime.on_error += errors.append
    for tick in range(5):
        hand = ours.physics.model.name2id("left_hand", "body")
        ours.physics.data.xfrc_applied[hand, 2] = 20.0 if tick == 2 else 0.0
        with ours.physics.check_invalid_state():
            runtime.tick(0.02, paused=False)
    assert errors == []
    assert runtime.get_time() == pytest.approx(0.1, abs=0.03)
    runtime.stop()


UNDER_XVFB = """
import glfw
import numpy as np
from dm_control.viewer import application
from humanoid_sim.envs import dm

window = application.Application(width=160, height=120)
window._pause_subject.value = False  # it waits for the space bar
steps = []


def policy(time_step):
    steps.append(time_step)
    if len(steps) == 3:
        glfw.set_window_should_close(window._window._context.window, True)
    return np.zeros(14, dtype=np.float32)


window.launch(lambda: dm.load("lite_tracking", seed=0), policy)
print(len(steps), round(window._runtime.get_time(), 6), window._status._value["Error"])
"""


@pytest.mark.soak
@pytest.mark.skipif(shutil.which("xvfb-run") is None, reason="xvfb-run is not installed (xvfb)")
def test_the_viewer_opens_it():
    pytest.importorskip("glfw")
    # Tests before this one may have chosen an OpenGL without windows for this process.
    inherited = {name: value for name, value in os.environ.items() if name != "PYOPENGL_PLATFORM"}
    done = subprocess.run(
        ["xvfb-run", "-a", sys.executable, "-W", "ignore", "-c", UNDER_XVFB],
        check=False,
        capture_output=True,
        text=True,
        timeout=200,
        env={**inherited, "MUJOCO_GL": "glfw"},
    )
    assert done.returncode == 0, done.stderr
    steps, time, error = done.stdout.split()
    assert int(steps) >= 3
    assert float(time) >= 0.04
    assert error == "--"
