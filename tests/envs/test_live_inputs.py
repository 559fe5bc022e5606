"""Environments whose policy observes what only Python code knows."""

import json

import gymnasium
import numpy as np
import pytest
from alike import hasty

from humanoid_sim.envs.modes_env import ModesEnv
from humanoid_sim.envs.spaces import INTENTS
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent, Mode
from humanoid_sim.robots.description import load_robot

POLICY = "humanoid_sim/Policy-v0"
LITE = load_robot("lite")
COUNT = 3


def tilt(state):
    """Of the first two joints, in a unit of nobody's."""
    return np.sin(3.0 * state.joint_position[..., :2]) + np.square(state.joint_velocity[..., :2])


@pytest.fixture
def contract(tmp_path):
    """As somebody would write it by hand; JSON is YAML."""
    n = len(LITE.joint_names)
    path = tmp_path / "contract.yaml"
    fields = {
        "joint_names": list(LITE.joint_names),
        "joint_stiffness": 20.0,
        "joint_damping": 1.0,
        "default_joint_pos": [0.0] * n,
        "action_scale": 0.25,
        "policy_dt": 0.02,
        "observation": ["joint_pos", {"name": "tilt", "width": 2, "history": 2}, "actions"],
    }
    path.write_text(json.dumps(fields), encoding="utf-8")
    return path


def single(contract, **options):
    return gymnasium.make(POLICY, contract=str(contract), robot=LITE, **options).unwrapped


def test_single_and_vector_environments_observe_the_same_bits(contract):
    vector = gymnasium.make_vec(
        POLICY,
        num_envs=COUNT,
        vectorization_mode="vector_entry_point",
        contract=str(contract),
        robot=LITE,
        live={"tilt": tilt},
        threads=1,
    )
    ones = [single(contract, live={"tilt": tilt}) for _ in range(COUNT)]
    rng = np.random.default_rng(4)
    weights = rng.normal(0.0, 0.3, (2 * len(LITE.joint_names) + 4, len(LITE.joint_names))).astype(np.float32)
    together, _ = vector.reset(seed=7)
    alone = np.stack([env.reset(seed=7 + i)[0] for i, env in enumerate(ones)])
    places = slice(len(LITE.joint_names), len(LITE.joint_names) + 4)
    for _ in range(20):
        np.testing.assert_array_equal(together, alone)
        assert np.abs(together[:, places]).min() > 0.0
        actions = np.stack([np.tanh(row @ weights) for row in alone])
        together, *_ = vector.step(actions)
        alone = np.stack([env.step(action)[0] for env, action in zip(ones, actions, strict=True)])
    chosen = np.array([False, True, False])
    rest, _ = vector.reset(seed=[None, 30, None], options={"reset_mask": chosen})
    np.testing.assert_array_equal(rest[1], ones[0].reset(seed=30)[0])
    np.testing.assert_array_equal(rest[[0, 2]], alone[[0, 2]])


@pytest.mark.parametrize("make", [single, lambda contract, **options: ModesEnv(LITE, str(contract), **options)])
def test_nothing_that_feeds_it_is_one_line(make, contract):
    with pytest.raises(InputError) as caught:
        make(contract)
    assert "policy on robot 'lite': observation term 'tilt' needs the live input 'tilt'" in str(caught.value)
    with pytest.raises(
        InputError,
        match=r"^policy on robot 'lite': live: unknown live input 'tlit' .did you mean 'tilt'..; known: tilt",
    ):
        make(contract, live={"tlit": tilt})


def test_a_value_that_is_not_finite_ends_the_episode(contract):
    env = single(contract, live={"tilt": lambda state: [0.0, np.nan if state.time > 0.01 else 0.0]})
    env.reset(seed=0)
    _, reward, terminated, truncated, info = env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    assert (reward, terminated, truncated) == (0.0, True, False)
    assert info["fault"].startswith("observation tilt[1] of history step 1 is nan, expected a finite number")


def standing(contract, live):
    """The whole stack at the end of its standby, whose segments are short."""
    options = {"robot": hasty(), "policy": str(contract), "motion": None, "live": live}
    env = gymnasium.make("humanoid_sim/LiteModes-v0", **options).unwrapped
    assert isinstance(env, ModesEnv)
    env.reset(seed=0)
    shown = {}
    for intent in (Intent.DAMP, Intent.LOAD_A, *[None] * 60):
        shown, *_ = env.step(INTENTS.index(intent))
    return env, shown


def test_the_whole_stack_takes_it_too(contract):
    heard = []

    def told(state):
        heard.append(state.time)
        return tilt(state)

    env, _ = standing(contract, {"tilt": told})
    shown, *_, info = env.step(INTENTS.index(Intent.START_LOCOMOTION))
    assert (Mode(shown["mode"]), info["faults"]) == (Mode.LOCOMOTION, ())
    heard.clear()
    for _ in range(10):
        shown, *_ = env.step(0)
    assert Mode(shown["mode"]) is Mode.LOCOMOTION
    assert len(heard) == 10  # once in every tick
    np.testing.assert_allclose(np.diff(heard), 0.005, atol=1e-9)


@pytest.mark.parametrize(("value", "told"), [([0.0, np.nan], "tilt[1]"), ([0.0] * 3, "'tilt'")])
def test_the_whole_stack_falls_back_on_a_bad_value(contract, value, told):
    env, _ = standing(contract, {"tilt": lambda _: value})
    shown, *_, info = env.step(INTENTS.index(Intent.START_LOCOMOTION))
    assert Mode(shown["mode"]) is Mode.DAMPING
    assert len(info["faults"]) == 1
    assert told in info["faults"][0]
