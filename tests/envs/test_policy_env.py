"""One robot: configuration, seeds, what ends an episode, and the same trajectory as in `play`."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from alike import BIPED, LITE, STILL, both, hasty

from humanoid_sim.assets import SAMPLE_POLICY, WALKING_POLICY, motion_path
from humanoid_sim.envs.config import CONFIGS
from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent, Mode, TickInput
from humanoid_sim.mit import VELOCITY_COMMAND, Extern
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.simulation.floating_base import support_in_mode
from humanoid_sim.simulation.model import SimConfig
from humanoid_sim.simulation.sim_robot import SimRobot
from humanoid_sim.stack import build_supervisor

TRACKING = CONFIGS["lite_tracking"]


@pytest.fixture(scope="module")
def env():
    made = PolicyEnv(TRACKING)
    yield made
    made.close()


def zeros(env):
    return np.zeros(env.action_space.shape, dtype=np.float32)


def test_a_configuration_and_keywords_make_the_same_environment():
    config = replace(TRACKING, motion="circle", joint_noise=0.0)
    ours = gymnasium.make(LITE, config=config)
    theirs = gymnasium.make(LITE, motion="circle", joint_noise=0.0)
    np.testing.assert_array_equal(ours.reset(seed=1)[0], theirs.reset(seed=1)[0])
    assert ours.unwrapped.config == theirs.unwrapped.config


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"moton": "wave"}, r"unknown option 'moton' \(did you mean 'motion'\?\)"),
        ({"config": "lite_trackin"}, "did you mean 'lite_tracking'"),
        ({"task": "juggling"}, "task: unknown task 'juggling'"),
        ({"task": "piano"}, "task: piano needs a motion with target_keys"),
        ({"rewards": {"body_positon": 1.0}}, r"rewards: unknown metric 'body_positon' \(did you mean 'body_position'"),
        ({"rewards": {"f1": 1.0}}, "f1: needs a song"),
        ({"rewards": {"alive": float("nan")}}, "weight of alive is nan"),
        ({"terminations": ("fallen",)}, "fallen: needs a floating base"),
        ({"max_episode_steps": 0, "config": TRACKING}, "max_episode_steps: is 0, expected a whole number >= 1"),
        ({"joint_noise": -1.0}, "joint_noise: is -1.0"),
        ({"motion": "polka"}, "polka"),
        ({"motion": "ode", "config": "lite_piano"}, "motion: unknown song 'ode'"),
        ({"physics_timestep": 0.005}, "unstable above 2"),
        ({"randomisation": {"colour": (0, 1)}}, "randomisation: unknown field 'colour'; known: mass, "),
        ({"implicit": True}, "implicit: .*expected a vector environment"),
        ({"render_mode": "ascii"}, "render_mode: is 'ascii'"),
    ],
)
def test_options_that_do_not_fit_are_named(options, message):
    config = options.pop("config", "lite_tracking")
    with pytest.raises(InputError, match=message):
        PolicyEnv(config, **options)


@pytest.mark.parametrize(
    ("option", "value"), [("qpos", np.zeros(3)), ("qpos", np.full(14, np.nan)), ("qvel", [1.0]), ("warmstart", "rest")]
)
def test_a_state_to_begin_in_has_the_model_s_shape_and_is_finite(env, option, value):
    with pytest.raises(InputError, match=f"reset: {option} is .*, expected 14 finite numbers"):
        env.reset(options={option: value})


def test_the_shipped_policy_follows_its_motion_to_the_end(env):
    observation, info = env.reset(seed=0)
    earned, over = 0.0, False
    while not over:
        observation, reward, terminated, over, info = env.step(env.scenario.policy(observation, info["frame"]))
        assert not terminated, info
        earned += reward
    assert info["frame"] == env.max_episode_steps == 400
    assert earned == pytest.approx(11.95, abs=0.05)


@pytest.mark.parametrize(
    ("action", "fault"),
    [(np.nan, "action of left_shoulder_pitch is nan"), (101.0, "is 101.0, expected a magnitude <= 100"), (1e39, "inf")],
)
def test_an_action_that_the_controller_refuses_ends_the_episode(env, action, fault):
    env.reset(seed=0)
    _, reward, terminated, truncated, info = env.step(np.full(14, action))
    assert (reward, terminated, truncated, info["terms"]) == (0.0, True, False, {})
    assert fault in info["fault"]


def test_a_simulation_that_breaks_ends_the_episode(env):
    env.reset(seed=0, options={"qvel": np.full(env.robot.model.nv, 1e12)})
    _, _, terminated, _, info = env.step(zeros(env))
    assert terminated
    assert info["fault"].startswith("simulation unstable")
    env.reset(seed=0)
    assert not env.step(zeros(env))[2]


def pressing(contract, step):
    """Shape (14,): an action that leads a wrist into its stop and beyond, within 15 steps."""
    i = contract.action_joint_names.index("left_wrist_roll")
    start = contract.default_joint_pos[contract.joint_names.index("left_wrist_roll")]
    action = np.zeros(14, dtype=np.float32)
    action[i] = min(step / 15, 1.0) * (0.9 - start) / np.broadcast_to(contract.action_scale, action.shape)[i]
    return action


@pytest.mark.parametrize("guards", [True, False])
def test_a_guard_ends_the_episode_of_one_among_many_as_it_does_alone(guards):
    """The second is pressed into its stop; it is watched afresh in its next episode."""
    native, sync = both(LITE, 3, guards=guards, **STILL)
    native.reset(seed=3)
    sync.reset(seed=3)
    step, ends = 0, []
    for _ in range(52):
        actions = np.zeros((3, 14), dtype=np.float32)
        actions[1] = pressing(native.scenario.contract, step)
        ours, theirs = native.step(actions), sync.step(actions)
        np.testing.assert_array_equal(ours[2], theirs[2])
        step += 1
        if ours[2].any():
            assert ours[2].tolist() == [False, True, False]
            assert ours[4]["fault"][1] == theirs[4]["fault"][1]
            assert ours[4]["fault"][1].startswith("following guard: left_wrist_roll does not follow")
            ends.append(step)
            step = -1  # in between is the step in which its next episode begins
    assert len(set(ends)) == guards
    assert len(ends) >= 2 * guards
    assert all(15 <= end <= 31 for end in ends)


def test_what_is_no_step_is_refused(env):
    fresh = PolicyEnv(TRACKING)
    with pytest.raises(gymnasium.error.ResetNeeded):
        fresh.step(zeros(fresh))
    env.reset(seed=0)
    with pytest.raises(InputError, match=r"action: has shape \(3,\), expected \(14,\)"):
        env.step(np.zeros(3))


def played(robot, policy, motion, command, steps):
    """The stack with that policy, to the end of its first policy steps: the start as options of a reset, and ticks."""
    checkpoint = load_checkpoint(policy)
    loaded = load_policy(checkpoint.contract, checkpoint.policy, None if motion is None else read_motion(motion))
    sim = SimRobot(robot, SimConfig(drop=0.05))
    supervisor = build_supervisor(robot, sim.control_period, loaded)
    memory, start, found = supervisor.initial(), {}, []
    intents = [Intent.DAMP, Intent.LOAD_A, *[None] * 60, Intent.START_LOCOMOTION, *[None] * 4 * steps]
    for intent in intents:
        state, safety = sim.read()
        state = replace(state, extern={**state.extern, VELOCITY_COMMAND: Extern(np.array(command), 0.0)})
        if intent is Intent.START_LOCOMOTION:
            data = sim.data
            start = {"qpos": data.qpos, "qvel": data.qvel, "warmstart": data.qacc_warmstart}
            start = {name: array.copy() for name, array in start.items()} | {"command": command}
        memory, output = supervisor.step(memory, TickInput(state, safety, () if intent is None else (intent,)))
        if output.policy_step is not None:
            assert output.control_mode.mode is Mode.LOCOMOTION
            found.append((output.policy_step, state))
        if robot.is_floating:
            support_in_mode(sim, output.control_mode.mode)
        sim.write(output.command)
    return start, found[:steps]


@pytest.mark.parametrize(
    ("config", "name", "policy", "motion", "command"),
    [
        ("lite_tracking", "lite", SAMPLE_POLICY, motion_path("wave"), (0.0, 0.0, 0.0)),
        ("biped_velocity", "lite_biped", WALKING_POLICY, None, (0.3, 0.0, 0.2)),
    ],
)
def test_a_policy_does_the_same_as_in_play_to_the_bit(config, name, policy, motion, command):
    robot = hasty(name)
    start, steps = played(robot, policy, motion, command, 25)
    env = PolicyEnv(config, policy=policy, robot=robot)
    observation, info = env.reset(options=start)
    for step, state in steps:
        assert env.robot.state().joint_position.tobytes() == state.joint_position.tobytes()
        assert observation.tobytes() == step.observation.tobytes()
        assert info["frame"] == step.frame
        observation, _, terminated, _, info = env.step(step.action)
        assert not terminated, info


def test_episodes_end_with_the_motion_or_after_so_many_steps():
    assert gymnasium.make(BIPED).unwrapped.max_episode_steps == 1000
    env = PolicyEnv(TRACKING, max_episode_steps=2)
    env.reset(seed=0)
    assert [env.step(zeros(env))[3] for _ in range(2)] == [False, True]
