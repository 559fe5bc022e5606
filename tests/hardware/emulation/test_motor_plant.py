"""What the motors move, seen from their shafts; and how warm they get."""

import numpy as np
import pytest
from bus_rig import LITE
from msgspec.structs import replace

from humanoid_sim.hardware.emulation.motors import RATED_RISE, TIME_CONSTANT, heat
from humanoid_sim.hardware.emulation.plant import MotorPlant
from humanoid_sim.hardware.emulation.settings import EmulationSettings
from humanoid_sim.hardware.tools.emulate import HandSweep
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.mjcf import bare_model
from humanoid_sim.robots.motors import MOTORS
from humanoid_sim.simulation.mujoco_robot import MujocoRobot

DIRECTION = np.array([joint.motor.direction for joint in LITE.joints if joint.motor is not None])


def test_shafts_turn_as_the_calibration_says():
    plant = MotorPlant(LITE, EmulationSettings(homing_offset={"left_elbow_pitch": 0.7}))
    offset = np.where(np.array(LITE.joint_names) == "left_elbow_pitch", 0.7, 0.0)
    np.testing.assert_allclose(plant.shaft, DIRECTION * LITE.initial_position + offset, atol=1e-12)
    torque = 3.0 * DIRECTION
    for _ in range(40):
        plant.step(torque)
    truth = plant.truth(1.5)
    np.testing.assert_allclose(plant.shaft, DIRECTION * truth.joint_position + offset, atol=1e-12)
    np.testing.assert_allclose(plant.velocity, DIRECTION * truth.joint_velocity, atol=1e-12)
    np.testing.assert_allclose(truth.joint_effort, np.full(14, 3.0), atol=1e-12)
    assert truth.time == 1.5
    assert truth.joint_velocity[LITE.joint_names.index("left_wrist_yaw")] > 1.0, "a positive torque, joint frame"
    assert plant.fault() == ""


def test_an_imu_on_a_moving_body_feels_what_it_does_in_simulation():
    """The same torques, and a body whose inertia is turned against its axes."""
    model = bare_model(LITE)
    body = model.body(model.jnt_bodyid[model.joint("left_elbow_pitch").id])
    assert abs(body.iquat[0]) < 0.999
    robot = replace(LITE, imu=body.name)
    plant, simulated = MotorPlant(robot, EmulationSettings()), MujocoRobot(robot)
    torque = np.linspace(-1.0, 1.0, 14)
    zeros = np.zeros(14)
    for _ in range(8):
        simulated.write(MITCommand(zeros, zeros, torque, zeros, zeros))
        for _ in range(simulated.physics_steps):
            plant.step(DIRECTION * torque)
    state, felt = simulated.read()[0], plant.truth(0.0).imu
    np.testing.assert_array_equal(felt.quaternion, state.imu_quaternion)
    np.testing.assert_array_equal(felt.angular_velocity, state.imu_angular_velocity)
    np.testing.assert_array_equal(felt.linear_acceleration, state.imu_linear_acceleration)
    assert np.all(np.abs(felt.angular_velocity) > 0.01)


def test_windings_at_rated_torque_end_at_the_rated_rise():
    rated = np.array([MOTORS["rs-00"].rated_torque, MOTORS["rs-05"].rated_torque])
    rise = heat(np.zeros(2), rated, rated, TIME_CONSTANT)
    np.testing.assert_allclose(rise, RATED_RISE * (1.0 - np.exp(-1.0)))
    np.testing.assert_allclose(heat(rise, rated, rated, 1e5), RATED_RISE)
    np.testing.assert_allclose(heat(rise, np.zeros(2), rated, 1e5), 0.0, atol=1e-9)
    halves = heat(heat(rise, 2 * rated, rated, 5.0), 2 * rated, rated, 5.0)
    np.testing.assert_allclose(halves, heat(rise, 2 * rated, rated, 10.0), rtol=1e-12)


def test_a_hand_sweeps_one_joint_after_the_other_from_stop_to_stop_and_begins_again():
    plant = MotorPlant(LITE, EmulationSettings())
    sweep = HandSweep(LITE, np.array(LITE.initial_position))
    reached = []
    for step in range(round((2.0 + 4.0) / plant.timestep)):
        if step % 100 == 0:
            plant.lead(sweep.at(step * plant.timestep))
        plant.step(np.zeros(14))
        reached.append(plant.shaft * DIRECTION)
    lowest, highest = np.min(reached[4000:], axis=0), np.max(reached[4000:], axis=0)
    joint = LITE.joints[0]
    assert (lowest[0], highest[0]) == (pytest.approx(joint.lower, abs=0.06), pytest.approx(joint.upper, abs=0.06))
    np.testing.assert_allclose(lowest[7:], np.zeros(7), atol=0.2)
    np.testing.assert_allclose(highest[7:], np.zeros(7), atol=0.2)
    led = []
    for time in np.arange(2.0 + 1.0, 15 * 4.0 + 2.0, 4.0):
        position = sweep.at(time)
        led.append([name for name in LITE.joint_names if position[name]])
    assert led == [[name] for name in (*LITE.joint_names, LITE.joint_names[0])]
