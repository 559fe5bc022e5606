import numpy as np
import pytest
from drive import Drive

from humanoid_sim.messages import Intent, Mode
from humanoid_sim.simulation.kinematics import GravityTorque


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


def test_a_walk_that_is_interrupted_begins_again_from_where_the_arms_are():
    drive = Drive()
    drive.step(Intent.DAMP)
    drive.step(Intent.LOAD_A)
    drive.run(3.0)
    drive.step(Intent.DAMP)
    drive.run(0.2)
    entered = len(drive.states)
    drive.step(Intent.LOAD_B)
    drive.run(0.5)
    start = drive.states[entered].joint_position
    first = drive.outputs[entered].command
    assert first.position.tolist() == start.tolist()
    assert not first.stiffness.any()
    assert np.abs(np.diff(drive.applied(entered + 1), axis=0)).max() < 0.5
