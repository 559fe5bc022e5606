"""Mock motors on their buses, and what they move."""

import math
import time

import numpy as np
import pytest
from waiting import until

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.mock.faults import Fault, parse_fault
from humanoid_sim.hardware.mock.motors import MockMotors
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.hardware.robstride.protocol import (
    FrameType,
    OperationControl,
    decode_operation,
    encode_command,
    encode_operation,
)
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import SimConfig
from humanoid_sim.simulation.sim_robot import SimRobot

LITE = load_robot("lite")
ELBOW = "left_elbow_pitch"


def test_the_physics_are_those_of_the_simulated_robot_under_the_quantised_commands():
    period, steps = 0.005, 60
    mock, robot = MockMotors(LITE), SimRobot(LITE, SimConfig(control_period=period))
    for motor in mock.motors:
        mock.submit(0, encode_command(FrameType.ENABLE, motor.can_id), 0.0)
    mock.advance(0.1 + 1e-9)
    for _ in range(20):
        robot.write(MITCommand.zeros(14))
    for step in range(steps):
        wanted = LITE.initial_position + 0.2 * np.sin(0.1 * step * np.ones(14))
        quantised = np.zeros((5, 14))
        for i, motor in enumerate(mock.motors):
            direction = LITE.joints[i].motor.direction
            turn = round(-motor.origin / (2 * math.pi)) * 2 * math.pi  # between its own zero and the joint's
            command = OperationControl(direction * wanted[i] + turn, 0.0, 0.0, 50.0, 2.0)
            frame = encode_operation(motor.can_id, command, motor.model)
            read = decode_operation(frame, motor.model)
            position, velocity, effort = read.position - turn, read.velocity, read.effort
            quantised[:, i] = (*(direction * v for v in (position, velocity, effort)), read.stiffness, read.damping)
            mock.submit(0, frame, mock.time)
        mock.advance(0.1 + (step + 1) * period + 1e-9)
        robot.write(MITCommand(*quantised))
    state, _ = robot.read()
    truth = mock.plant.truth(0.0)
    assert np.abs(state.joint_position - LITE.initial_position).max() > 0.05, "they have moved"
    np.testing.assert_allclose(truth.joint_position, state.joint_position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(truth.joint_effort, state.joint_effort, rtol=0, atol=1e-6)
    np.testing.assert_allclose(truth.imu_quaternion, state.imu_quaternion, rtol=0, atol=1e-9)


def test_a_floating_base_is_held_and_let_go():
    motors = MockMotors(load_robot("lite_biped"))
    motors.advance(0.1)
    height = motors.plant.data.qpos[2]
    assert motors.plant.support.holds
    motors.plant.support.move(False)
    motors.advance(0.4)
    assert motors.plant.data.qpos[2] < height - 0.02, "without torque its knees give way"


def test_the_clock_of_motors_in_real_time_waits_for_them_where_they_are_late():
    ahead = []

    def hold_up(mock):
        time.sleep(0.1)
        ahead.append(motors.clock() - mock.time)

    with MockServer(LITE, ["virtual:mock"]) as motors:
        motors.call(hold_up)
        assert ahead[0] == pytest.approx(0.05), "s, and no more"
        until(lambda: motors.stood_still > 0.03)


# --- faults


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("silent=0.2:left_elbow_pitch,right_elbow_pitch", Fault("silent", (ELBOW, "right_elbow_pitch"), value=0.2)),
        ("over_temperature=150:left_elbow_pitch@5+2", Fault("over_temperature", (ELBOW,), 5.0, 2.0, 150.0)),
        ("encoder_jump=-1e-1@.5", Fault("encoder_jump", (), 0.5, math.inf, -0.1)),
        (" bus_off@3 ", Fault("bus_off", start=3.0)),
    ],
)
def test_a_fault_is_read(text, fault):
    assert parse_fault(text, LITE) == fault


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("silent:left_elbow_pitch@x", ["KIND[=VALUE]"]),
        ("silent=nan", ["nan", "0 to 1"]),
        ("silent:elbow", ["elbow", "left_shoulder_pitch"]),
    ],
)
def test_a_refused_fault_says_why(text, words):
    with pytest.raises(InputError) as refused:
        parse_fault(text, LITE)
    assert all(word in str(refused.value) for word in [f"--fault '{text}'", *words])
