"""Many robots: each does what one does alone, and touches no other."""

import gymnasium
import numpy as np
import pytest
from alike import BIPED, EVERYTHING, LITE, PIANO, PUSHED, both, same_info, walk_along

from humanoid_sim.envs.vector_env import PolicyVectorEnv
from humanoid_sim.errors import InputError


def make(config="lite_tracking", count=3, **options):
    return PolicyVectorEnv(count, config, threads=1, **options)


def zeros(envs):
    return np.zeros(envs.action_space.shape, dtype=np.float32)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        (LITE, {}),
        (BIPED, {}),
        (PIANO, {}),
        (LITE, {"randomisation": EVERYTHING}),
        (BIPED, {"randomisation": PUSHED}),
    ],
)
def test_every_environment_does_what_one_does_alone(name, options):
    native, sync = both(name, 3, **options)
    walk_along(native, sync, 14, 0.2)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_episodes_begin_again_as_gymnasium_defines_it(mode):
    native = make(max_episode_steps=3, autoreset_mode=mode)
    sync = gymnasium.vector.SyncVectorEnv(
        [lambda: gymnasium.make(LITE, max_episode_steps=None).unwrapped] * 3, autoreset_mode=mode
    )
    for env in sync.envs:
        env.scenario.task.episode_steps = 3
    np.testing.assert_array_equal(native.reset(seed=5)[0], sync.reset(seed=5)[0])
    for step in range(9):
        action = zeros(native)
        if step == 1:
            action[1] = np.nan
        ours, theirs = native.step(action), sync.step(action)
        for i in range(4):
            np.testing.assert_allclose(ours[i], theirs[i], rtol=0, atol=1e-6)
        info, other = ours[4], theirs[4]
        assert ("final_obs" in info) == ("final_obs" in other)
        for i in np.flatnonzero(info.pop("_final_obs", [])):
            np.testing.assert_allclose(info["final_obs"][i], other["final_obs"][i], rtol=0, atol=1e-6)
        for key in ("final_obs", "_final_obs"):
            info.pop(key, None)
            other.pop(key, None)
        same_info(info, other)


def test_neither_company_nor_threads_matter():
    randomisation = {"mass": (0.8, 1.2), "delay": (0.0, 0.02)}
    few = make(count=1, randomisation=randomisation)
    many = PolicyVectorEnv(5, "lite_tracking", threads=2, randomisation=randomisation)
    observed, _ = few.reset(seed=13)
    np.testing.assert_array_equal(observed[0], many.reset(seed=10)[0][3])
    many.action_space.seed(0)
    for _ in range(4):
        action = 0.1 * many.action_space.sample()
        ours, all_of_them = few.step(action[3:4]), many.step(action)
        np.testing.assert_array_equal(ours[0][0], all_of_them[0][3])
        np.testing.assert_array_equal(ours[1][0], all_of_them[1][3])


def test_seeds_make_starts():
    envs = make()
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset before step"):
        envs.step(zeros(envs))
    first, _ = envs.reset(seed=7)
    np.testing.assert_array_equal(first, envs.reset(seed=[7, 8, 9])[0])
    assert np.abs(first - envs.reset()[0]).max() > 1e-3
    assert np.abs(make().reset()[0] - make().reset()[0]).max() > 1e-3, "no seed: any start"


def test_a_simulation_that_breaks_ends_its_episode_only():
    envs = make()
    envs.reset(seed=0)
    last = envs.step(zeros(envs))[0]
    qvel = envs.simulation.qvel[2:].copy()
    qvel[0, 2] = 1e12
    envs.simulation.reset([2], qpos=envs.simulation.qpos[2:].copy(), qvel=qvel)
    observation, reward, terminated, _, info = envs.step(zeros(envs))
    assert terminated.tolist() == [False, False, True]
    assert reward[2] == 0.0
    assert info["fault"].tolist() == [None, None, "simulation unstable"]
    np.testing.assert_array_equal(observation[2], last[2])
    envs.step(zeros(envs))
    assert np.isfinite(envs.step(zeros(envs))[0]).all()


def test_commands_of_the_caller_hold():
    envs = make("biped_velocity", 2, implicit=True)
    term = next(term for term in envs.scenario.wiring.layout.terms if term.name == "velocity_commands")
    rows = np.array([[0.1, 0.0, 0.0], [0.2, 0.0, 0.0]])
    envs.reset(seed=0, options={"command": rows})
    for _ in range(3):
        observation, *_ = envs.step(zeros(envs))
    np.testing.assert_allclose(observation[:, term.start : term.stop], rows, rtol=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"autoreset_mode": "Later"}, "autoreset_mode: is 'Later', expected NextStep or SameStep"),
        ({"num_envs": 0}, "num_envs: is 0"),
        ({"autoreset": "SameStep"}, "unknown option 'autoreset'"),
    ],
)
def test_options_that_do_not_fit_are_named(options, message):
    with pytest.raises(InputError, match=message):
        gymnasium.make_vec(LITE, **{"num_envs": 2, "vectorization_mode": "vector_entry_point", **options})


def test_resets_and_actions_that_do_not_fit_are_named():
    envs = make()
    for arguments, message in (
        ({"seed": [1, 2]}, r"reset: seed is \[1, 2\], expected a whole number >= 0, or 3 of them"),
        ({"seed": -1}, "reset: seed is -1"),
        ({"options": {"speed": 1}}, "reset: unknown option 'speed'; known: command"),
        ({"options": {"command": (1.0, 2.0)}}, "reset: command is"),
        ({"options": {"command": "1,0,0"}}, "reset: command is '1,0,0', expected 3 finite numbers"),
        ({"options": {"command": np.ones((2, 3))}}, r"reset: command has shape \(2, 3\), expected"),
    ):
        with pytest.raises(InputError, match=message):
            envs.reset(**arguments)
    envs.reset(seed=0)
    with pytest.raises(InputError, match=r"action: has shape \(14,\), expected \(3, 14\)"):
        envs.step(np.zeros(14, dtype=np.float32))
