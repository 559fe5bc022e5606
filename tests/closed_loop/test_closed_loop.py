"""Whole stacks on simulated robots: each mode does to the robot what it is for."""

import numpy as np
import pytest
from drive import Drive

from humanoid_sim.assets import SAMPLE_POLICY, asset_path
from humanoid_sim.evaluation.run_figures import MotionErrors
from humanoid_sim.messages import Intent, Mode
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.simulation.kinematics import GravityTorque


@pytest.mark.parametrize("name", ["reach", "wave"])
def test_the_sample_policy_tracks_the_sample_motions(name):
    checkpoint = load_checkpoint(SAMPLE_POLICY)
    motion = read_motion(asset_path("motions", f"{name}.mcap"))
    loaded = load_policy(checkpoint.contract, checkpoint.policy, motion, checkpoint.observation_width)
    drive = Drive(loaded)
    errors = MotionErrors(drive.description, loaded)
    drive.stand()
    drive.step(Intent.START_LOCOMOTION)
    drive.run(motion.duration)
    frames = []
    for state, output in zip(drive.states, drive.outputs, strict=True):
        if output.policy_step is not None:
            frames.append(output.policy_step.frame)
            errors.update(output.policy_step.frame, state)
    assert frames == list(range(len(motion.frames)))
    assert drive.outputs[-1].control_mode.mode is Mode.LOCOMOTION
    summary = errors.summary()
    assert summary["errors"]["hand_position_error"]["rms"] <= 0.03
    assert summary["errors"]["hand_orientation_error"]["rms"] <= np.radians(12.0)
    assert np.abs(drive.applied()).max() < drive.description.effort_limit.max()


@pytest.mark.parametrize("load", [Intent.LOAD_A, Intent.LOAD_B])
def test_standby_reaches_its_pose_up_to_the_sag_of_its_springs(load):
    drive = Drive()
    drive.stand(load)
    robot = drive.description
    standby = robot.standby_controller_a if load is Intent.LOAD_A else robot.standby_controller_b
    goal = np.array(standby.pose_segments[-1])
    assert drive.outputs[-1].command.position.tolist() == goal.tolist()
    assert drive.time == pytest.approx(sum(standby.segment_durations), abs=0.02)
    drive.run(1.0)
    # A spring of stiffness K_p gives way by gravity / K_p; friction and what still moves add 0.1° or so.
    sag = np.abs(GravityTorque(robot)(drive.position)) / np.array(standby.target_stiffness)
    assert 0.01 < sag.max() < 0.1
    assert (np.abs(drive.position - goal) <= sag + 0.003).all()
    assert np.abs(drive.states[-1].joint_velocity).max() < 0.005
    assert drive.outputs[-1].control_mode.mode is Mode.STANDBY


@pytest.mark.parametrize("load", [Intent.LOAD_A, Intent.LOAD_B])
def test_gains_ramp_in_without_a_step_in_torque(load):
    drive = Drive()
    drive.run(1.0)
    drive.step(Intent.DAMP)
    drive.run(1.0)  # at rest
    entered = len(drive.states)
    drive.step(load)
    drive.run(4.1)
    change = np.abs(np.diff(drive.applied(entered - 1), axis=0)).max(axis=1)
    durations = drive.description.standby_controller_a.segment_durations
    ramp = round(durations[0] / drive.robot.control_period)
    assert change[:3].max() < 0.02  # N·m per tick of 5 ms: nothing jumps when it begins
    assert change[:ramp].max() < 0.1
    # The corner of the trajectory between its segments is a step in speed, which K_d turns into one of torque.
    assert change.max() < 0.5
    assert np.abs(drive.applied(entered)).max() > 1.0  # something was driven at all


def test_arms_that_are_let_go_sink_slowly():
    speeds = {}
    for intent in (Intent.DAMP, None):
        drive = Drive()
        drive.stand()
        if intent is None:  # without damping: what ZERO_TORQUE would do
            drive.memory = drive.supervisor.initial()
        drive.step(*([intent] if intent else []))
        drive.run(1.0)
        speeds[intent] = max(np.abs(state.joint_velocity).max() for state in drive.states[-200:])
    assert speeds[Intent.DAMP] < 1.0  # rad/s
    assert speeds[None] > 5.0
