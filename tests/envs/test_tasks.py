"""What tasks reward, what ends an episode, what is commanded, and where episodes begin."""

import re

import gymnasium
import numpy as np
import pytest
from alike import BIPED, LITE, STILL, both, following, walk_along

from humanoid_sim.assets import motion_path
from humanoid_sim.envs.config import CONFIGS, PolicyEnvConfig, build_scenario
from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.envs.vector_env import PolicyVectorEnv
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.step_metrics import METRICS
from humanoid_sim.policy.motion import Motion, read_motion
from humanoid_sim.robots.description import load_robot

LEGS = load_robot("lite_biped")
WAVE = read_motion(motion_path("wave"))
SHORT = Motion(WAVE.frames[:4], WAVE.body_names, WAVE.policy_dt)
LONGER = Motion(WAVE.frames[10:17], WAVE.body_names, WAVE.policy_dt)


def zeros(env):
    return np.zeros(env.action_space.shape, dtype=np.float32)


@pytest.mark.parametrize("config", CONFIGS)
def test_a_reward_is_the_sum_of_weighted_rows_of_the_table(config):
    env = PolicyEnv(config)
    env.reset(seed=0)
    _, reward, _, _, info = env.step(0.2 * env.action_space.sample())
    assert info["terms"].keys() <= METRICS.keys()
    assert reward == pytest.approx(sum(float(value) for value in info["terms"].values()))


def test_weights_and_functions_of_the_caller():
    def knees(sample):
        return np.abs(sample.state.joint_velocity[..., [3, 10]]).sum(axis=-1)

    options = {"rewards": {"knees": (-0.5, knees), "const": (1.0, lambda _: 2), "alive": 0.0, "rocking": -1.0}}
    native, sync = both(BIPED, 2, **options)
    walk_along(native, sync, 4)
    env = sync.envs[0].unwrapped
    *_, info = env.step(zeros(env))
    terms, speed = info["terms"], np.abs(env.robot.state().joint_velocity[[3, 10]]).sum()
    assert "alive" not in terms
    assert terms["knees"] == pytest.approx(-0.5 * 0.02 * speed)
    assert terms["const"] == pytest.approx(0.02 * 2.0)
    base = env.robot.base
    assert terms["rocking"] == pytest.approx(-0.02 * (base.angular_velocity[:2] ** 2).sum())


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda _: np.zeros(3), r"rewards: mine has shape \(3,\), expected \(\)"),
        (lambda _: float("nan"), "rewards: mine is not finite"),
    ],
)
def test_a_function_that_gives_no_reward_is_named(function, message):
    env = PolicyEnv("lite_tracking", rewards={"mine": (1.0, function)})
    env.reset(seed=0)
    with pytest.raises(InputError, match=message):
        env.step(zeros(env))


def test_what_terminates_can_be_chosen():
    thrown = {"qvel": np.r_[0.0, 0.0, 0.0, 0.0, 12.0, 0.0, np.zeros(14)]}
    ends = []
    for options in ({}, {"terminations": ()}):
        env = PolicyEnv("biped_velocity", guards=False, **options)
        env.reset(seed=0, options=thrown)
        ends.append(any(env.step(zeros(env))[2] for _ in range(12)))
    assert ends == [True, False]


def test_a_walking_robot_that_stands_as_commanded_earns_all_there_is():
    """And a foot that stays down in its swing earns less."""
    env = PolicyVectorEnv(2, "biped_velocity", task="walking", implicit=True, **STILL)
    env.reset(seed=0, options={"command": np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0]])})
    heights = []
    for _ in range(10):  # a quarter of the cycle: the left foot should be at its highest
        *_, info = env.step(zeros(env))
        heights.append(50.0 * info["terms"]["foot_height"][1])
    earned = {name: 50.0 * info["terms"][name][0] for name in info["terms"] if name[0] != "_"}
    assert earned["linear_velocity_sharp"] == pytest.approx(4.0, abs=0.4)
    assert earned["yaw_rate_sharp"] == pytest.approx(2.0, abs=0.1)
    assert earned["foot_height"] == pytest.approx(1.5, abs=0.05)
    assert [earned[name] for name in ("foot_slide", "foot_tilt", "sinking")] == pytest.approx([0.0] * 3, abs=0.01)
    assert heights[0] > 1.1
    assert heights[-1] < 0.9


@pytest.mark.parametrize(("task", "standing", "absent"), [("velocity", 0.1, 0.1), ("walking", 0.266, 0.44)])
def test_commands_are_within_the_contract_s_ranges_and_some_stand(task, standing, absent):
    made = build_scenario(PolicyEnvConfig(policy="lite_biped_velocity", robot=LEGS, task=task)).task
    commands = made.commands(np.random.default_rng(0).random((4000, made.command_draws)))
    assert commands.shape == (4000, 4, 3)  # 20 s, each holds for 5 s
    assert (commands == 0.0).all(axis=-1).mean() == pytest.approx(standing, abs=0.02)
    assert (commands[..., 0] == 0.0).mean() == pytest.approx(absent, abs=0.02)
    assert commands.min(axis=(0, 1)).tolist() == pytest.approx([-0.5, -0.4, -0.8], abs=0.01)
    assert commands.max(axis=(0, 1)).tolist() == pytest.approx([0.8, 0.4, 0.8], abs=0.01)
    steps = np.array([0, 249, 250, 999, 5000])
    chosen = made.command(commands[:5], steps)
    np.testing.assert_array_equal(chosen, commands[np.arange(5), [0, 0, 1, 3, 3]])


def test_each_episode_has_one_of_several_motions_to_its_own_end():
    native, sync = both(LITE, 4, motion=[SHORT, LONGER], joint_noise=0.01)
    assert native.max_episode_steps == 6
    frames = np.array(walk_along(native, sync, 20))
    shown = ["".join(f"{frame:x}" for frame in column) for column in frames.T]
    for text in shown:
        assert re.fullmatch("(0123|456789a)+(0|01|012|4|45|456|4567|45678|456789)?", text), text
    assert "0123" in "".join(shown)
    assert "456789a" in "".join(shown)


def test_a_motion_among_others_is_rewarded_as_it_is_alone():
    alone = PolicyEnv("lite_tracking", motion=LONGER, **STILL)
    among = PolicyEnv("lite_tracking", motion=[SHORT, LONGER], **STILL)
    seed = next(seed for seed in range(20) if among.reset(seed=seed)[1]["frame"] == 4)
    np.testing.assert_array_equal(alone.reset(seed=0)[0], among.reset(seed=seed)[0])
    for i in range(1, 7):
        ours, theirs = (env.step(np.zeros(14, dtype=np.float32)) for env in (alone, among))
        np.testing.assert_array_equal(ours[0], theirs[0])
        assert ours[1:4] == theirs[1:4]
        assert (ours[4]["frame"], theirs[4]["frame"]) == (i, i + 4)
    assert ours[3]


def squat(height=0.9):
    """A walk ahead of the legs' base at 0.5 m/s while it sinks, and the policy that sees it from where it is."""
    frames = np.zeros((9, 2 * 14 + 7))
    frames[:, :14] = LEGS.initial_position
    frames[:, [3, 10]] += 0.02 * np.arange(9)[:, None]
    frames[:, 28] = 1.0 + 0.01 * np.arange(9)
    frames[:, 30] = height - 0.004 * np.arange(9)
    frames[:, 31] = 1.0
    return Motion(frames, ("pelvis",), 0.02, layout="joints_bodies_w", joint_names=LEGS.joint_names)


SQUAT = PolicyEnvConfig(policy=following(LEGS), robot=LEGS, motion=squat(), reference_start=1.0)


@pytest.mark.parametrize("options", [{}, {"randomisation": {"mass": (0.9, 1.1), "delay": (0.0, 0.02)}}])
def test_single_and_many_begin_alike_in_the_middle_of_several_motions(options):
    native, sync = both(BIPED, 5, config=SQUAT, motion=[squat(), squat()], **{"reference_start": 0.5, **options})
    frames = walk_along(native, sync, 12, seed=1)
    assert not set(frames[0].tolist()) <= {0, 9}


def test_a_base_that_floats_is_where_the_motion_has_it_and_moves_along():
    envs = PolicyVectorEnv(6, SQUAT, **STILL)
    observation, info = envs.reset(seed=3)
    base, frame = envs.simulation.base, info["frame"]
    assert len(set(frame.tolist())) > 2
    np.testing.assert_allclose(base.position[:, 2], 0.9 - 0.004 * frame, rtol=0, atol=1e-6)
    np.testing.assert_allclose(np.hypot(*base.position[:, :2].T), 1.0 + 0.01 * frame, rtol=0, atol=1e-6)
    np.testing.assert_allclose(base.planar_velocity[:, 0], 0.5, rtol=0, atol=1e-4)
    np.testing.assert_allclose(base.linear_velocity[:, 2], -0.2, rtol=0, atol=1e-4)
    np.testing.assert_allclose(envs.simulation.state().joint_velocity[:, [3, 10]], 1.0, rtol=0, atol=1e-4)
    # The motion is laid onto the robot, frame onto frame: it is shown where it is.
    anchor = next(term for term in envs.scenario.wiring.layout.terms if term.name == "motion_anchor_pos_b")
    np.testing.assert_allclose(observation[:, anchor.start : anchor.stop], 0.0, rtol=0, atol=1e-5)
    assert len(np.unique(base.yaw.round(3))) == 6


def test_feet_in_the_floor_are_lifted_onto_it():
    sunk = PolicyEnv(SQUAT, motion=squat(0.5), **STILL)
    standing = PolicyEnv(SQUAT, reference_start=0.0, **STILL)
    for env in (sunk, standing):
        env.reset(seed=0)
    assert sunk.robot.qpos[2] == pytest.approx(standing.robot.qpos[2], abs=0.1)


def test_songs_are_goals_and_several_motions_may_be_named():
    env = gymnasium.make("humanoid_sim/LitePiano-v0", motion=["ode_to_joy", "twinkle"]).unwrapped
    assert len(env.scenario.wiring.reference.lengths) == 2
