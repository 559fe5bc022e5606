"""Several motions in one environment, and episodes that begin in the middle of one."""

import re

import gymnasium
import numpy as np
import pytest
from alike import both, following, walk_along

from humanoid_sim.assets import motion_path
from humanoid_sim.envs.reference_states import reference_states
from humanoid_sim.envs.scenario import make_scenario
from humanoid_sim.errors import InputError
from humanoid_sim.policy.motion import Motion, read_motion
from humanoid_sim.robots.description import load_robot

pytestmark = pytest.mark.filterwarnings("ignore:.*recommend using a symmetric and normalized space")

LITE, POLICY = "humanoid_sim/LiteTracking-v0", "humanoid_sim/Policy-v0"
ROBOT, BIPED = load_robot("lite"), load_robot("lite_biped")
WAVE = read_motion(motion_path("wave"))
SHORT = Motion(WAVE.frames[:4], WAVE.body_names, WAVE.policy_dt)
LONGER = Motion(WAVE.frames[10:17], WAVE.body_names, WAVE.policy_dt)


def squat():
    """A walk ahead of the legs' base at 0.5 m/s while it sinks, and the policy that sees it from where it is."""
    frames = np.zeros((9, 2 * 14 + 7))
    frames[:, :14] = BIPED.initial_position
    frames[:, [3, 10]] += 0.02 * np.arange(9)[:, None]
    frames[:, 28] = 1.0 + 0.01 * np.arange(9)
    frames[:, 30] = 0.9 - 0.004 * np.arange(9)
    frames[:, 31] = 1.0
    return following(BIPED), Motion(frames, ("pelvis",), 0.02, layout="joints_bodies_w", joint_names=BIPED.joint_names)


def test_each_episode_has_one_of_several_motions_to_its_own_end():
    native, sync = both(LITE, 4, robot=ROBOT, motion=[SHORT, LONGER], joint_noise=0.01, actuation="implicit")
    assert native.max_episode_steps == 6
    reference = native.scenario.wiring.reference
    assert (reference.frame_count, reference.lengths) == (11, (4, 7))
    frames = np.array(walk_along(native, sync, 20))
    shown = ["".join(f"{frame:x}" for frame in column) for column in frames.T]
    for text in shown:
        assert re.fullmatch("(0123|456789a)+(0|01|012|4|45|456|4567|45678|456789)?", text), text
    assert "0123" in "".join(shown)
    assert "456789a" in "".join(shown)


def test_a_motion_among_others_is_rewarded_as_it_is_alone():
    alone = gymnasium.make(LITE, robot=ROBOT, motion=LONGER, joint_noise=0.0, velocity_noise=0.0)
    among = gymnasium.make(LITE, robot=ROBOT, motion=[SHORT, LONGER], joint_noise=0.0, velocity_noise=0.0)
    alone.reset(seed=0)
    seed = next(seed for seed in range(20) if among.reset(seed=seed)[1]["frame"] == 4)
    np.testing.assert_array_equal(alone.reset(seed=0)[0], among.reset(seed=seed)[0])
    for i in range(1, 7):
        ours, theirs = (env.step(np.zeros(14, dtype=np.float32)) for env in (alone, among))
        np.testing.assert_array_equal(ours[0], theirs[0])
        assert ours[1:4] == theirs[1:4]
        assert (ours[4]["frame"], theirs[4]["frame"]) == (i, i + 4)
    assert ours[3]


@pytest.mark.parametrize("options", [{}, {"randomisation": {"mass": (0.9, 1.1), "command_delay": (0.0, 0.02)}}])
def test_single_and_many_begin_alike_in_the_middle_of_several_motions(options):
    contract, motion = squat()
    given = {"contract": contract, "robot": BIPED, "motion": [motion, motion], "reference_start": 0.5}
    native, sync = both(POLICY, 5, actuation="implicit", **given, **options)
    frames = walk_along(native, sync, 12)
    assert not set(frames[0].tolist()) <= {0, 9}


def test_a_base_that_floats_is_where_the_motion_has_it_and_moves_along():
    contract, motion = squat()
    given = {"contract": contract, "robot": BIPED, "motion": motion, "reference_start": 1.0, "joint_noise": 0.0}
    native, sync = both(POLICY, 6, velocity_noise=0.0, **given)
    frames = walk_along(native, sync, 4)
    _, info = native.reset(seed=3)
    np.testing.assert_array_equal(info["frame"], frames[0])
    base, frame = native.simulation.base, frames[0]
    assert len(set(frame.tolist())) > 2
    np.testing.assert_allclose(base.position[:, 2], 0.9 - 0.004 * frame, rtol=0, atol=1e-6)
    np.testing.assert_allclose(np.hypot(*base.position[:, :2].T), 1.0 + 0.01 * frame, rtol=0, atol=1e-6)
    np.testing.assert_allclose(base.planar_velocity[:, 0], 0.5, rtol=0, atol=1e-4)
    np.testing.assert_allclose(base.linear_velocity[:, 2], -0.2, rtol=0, atol=1e-4)
    knees = native.simulation.truth().joint_velocity[:, [3, 10]]
    np.testing.assert_allclose(knees, 1.0, rtol=0, atol=1e-4)
    # The motion is laid onto the robot, frame onto frame: it is shown where it is.
    terms = native.scenario.wiring.layout.terms
    anchor = next(term for term in terms if term.name == "motion_anchor_pos_b")
    np.testing.assert_allclose(native._observation[:, anchor.start : anchor.stop], 0.0, rtol=0, atol=1e-5)
    assert len(np.unique(base.yaw.round(3))) == 6


def test_feet_in_the_floor_are_lifted_onto_it():
    contract, motion = squat()
    frames = motion.frames.copy()
    frames[:, 30] = 0.5
    sunk = Motion(frames, motion.body_names, 0.02, layout="joints_bodies_w", joint_names=motion.joint_names)
    scenario = make_scenario(contract, BIPED, sunk)
    states = reference_states(scenario.description, scenario.contract, scenario.wiring.reference)
    height = float(gymnasium.make(POLICY, contract=contract, robot=BIPED, motion=motion).unwrapped.robot.qpos[2])
    assert height - 0.1 < states.base_pose[0, 2] <= height + 0.01


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        (LITE, {"reference_start": 1.5}, "reference_start: is 1.5, expected a number from 0 to 1"),
        (LITE, {"reference_start": "all"}, "reference_start: is 'all', expected a number from 0 to 1"),
        (
            "humanoid_sim/BipedVelocity-v0",
            {"robot": BIPED, "reference_start": 0.5},
            "reference_start: is 0.5, but the policy follows no motion with joints",
        ),
        (LITE, {"motion": []}, "motion: is an empty list, expected a motion or several"),
        (LITE, {"motion": ["wave", "polka"]}, "polka"),
    ],
)
def test_what_there_is_not_is_refused(name, options, message):
    with pytest.raises(InputError, match=message):
        gymnasium.make(name, **{"robot": ROBOT, **options})
