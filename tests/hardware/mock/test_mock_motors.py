"""Mock motors on their buses and what they move, at times of the test's choosing; no thread and no clock."""

import math

import numpy as np
import pytest
from mock_rig import IDS, LITE, MODELS, Bench

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.mock.faults import Fault, parse_fault
from humanoid_sim.hardware.mock.motors import MockMotors
from humanoid_sim.hardware.robstride.protocol import (
    MotorMode,
    OperationControl,
    StatusFault,
    decode_operation,
    encode_operation,
)
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import SimConfig
from humanoid_sim.simulation.sim_robot import SimRobot

ELBOW, ELBOW_ID = "left_elbow_pitch", 14
DIRECTION = np.array([joint.motor.direction for joint in LITE.joints])


@pytest.fixture
def bench():
    """The Lite's motors on one bus, enabled."""
    bench = Bench()
    bench.enable()
    return bench


def test_the_physics_are_those_of_the_simulated_robot_under_the_quantised_commands():
    period, steps = 0.005, 60
    bench = Bench()
    bench.enable()
    robot = SimRobot(LITE, SimConfig(control_period=period))
    bench.mock.advance(0.1 + 1e-9)
    for _ in range(20):
        robot.write(MITCommand.zeros(14))
    for step in range(steps):
        wanted = LITE.initial_position + 0.2 * np.sin(0.1 * step * np.ones(14))
        quantised = np.zeros((5, 14))
        for i, motor_id in enumerate(IDS):
            direction, model = DIRECTION[i], MODELS[motor_id]
            turn = bench.turn(i)
            command = OperationControl(direction * wanted[i] + turn, 0.0, 0.0, 50.0, 2.0)
            frame = encode_operation(motor_id, command, model)
            read = decode_operation(frame, model)
            position, velocity, effort = read.position - turn, read.velocity, read.effort
            quantised[:, i] = (*(direction * v for v in (position, velocity, effort)), read.stiffness, read.damping)
            bench.mock.submit(0, frame, bench.mock.time)
        bench.mock.advance(0.1 + (step + 1) * period + 1e-9)
        robot.write(MITCommand(*quantised))
    state, _ = robot.read()
    truth = bench.mock.plant.truth(0.0)
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


# --- faults


@pytest.mark.parametrize(
    ("fault", "bits"),
    [
        (Fault("over_temperature", (ELBOW,), duration=0.05), StatusFault.MOTOR_OVERTEMPERATURE),
        (Fault("brown_out", (ELBOW,), duration=0.05), StatusFault.UNDERVOLTAGE),
        (Fault("motor_fault", (ELBOW,), duration=0.05), StatusFault.PHASE_OVERCURRENT),
        (Fault("brown_out", (ELBOW,), duration=0.005, value=3.0), StatusFault(0)),
    ],
    ids=["hot", "low supply", "overcurrent", "no supply"],
)
def test_a_fault_of_a_motor_stops_it_and_it_does_not_recover(fault, bits, bench):
    bench.mock.inject(fault)
    for wait in (0.01, 0.1):  # while it lasts, and after it
        bench.advance(wait)
        replies = [reply for reply in bench.command(duration=0.02, effort=1.0) if reply.motor_id == ELBOW_ID]
        assert [(reply.mode, reply.faults) for reply in replies] == [(MotorMode.RESET, bits)]
        assert bench.torque()[IDS.index(ELBOW_ID)] == 0.0


def test_an_encoder_jump_moves_the_reading_and_the_motor_follows_it(bench):
    here = {reply.motor_id: reply.position for reply in bench.command(duration=0.02)}
    bench.mock.inject(Fault("encoder_jump", (ELBOW,), value=-0.3))
    command = OperationControl(here[ELBOW_ID], 0.0, 0.0, 50.0, 2.0)
    bench.submit(encode_operation(ELBOW_ID, command, MODELS[ELBOW_ID]))
    bench.advance(0.5)
    moved = bench.mock.plant.truth(0.0).joint_position[IDS.index(ELBOW_ID)]
    assert moved - LITE.initial_position[IDS.index(ELBOW_ID)] == pytest.approx(-0.3, abs=0.05)


def test_frames_are_lost_late_or_cut_as_a_fault_says(bench):
    bench.mock.inject(Fault("silent", (ELBOW,), duration=0.03))
    assert len(bench.command(duration=0.02)) == 13
    bench.advance(0.02)
    bench.mock.inject(Fault("late", (ELBOW,), duration=0.03, value=0.2))
    assert len(bench.command(duration=0.1)) == 13
    assert [reply.motor_id for reply in bench.advance(0.2)] == [ELBOW_ID]
    bench.mock.inject(Fault("garbage", (ELBOW,), value=5))
    assert len(bench.command(duration=0.02)) == 13
    assert [len(arrival.frame.data) for arrival in bench.log[-14:]].count(5) == 1


def test_two_motors_on_one_id_both_answer(bench):
    bench.mock.inject(Fault("wrong_id", (ELBOW,), value=15))
    replies = bench.command(duration=0.02)
    assert sorted(reply.motor_id for reply in replies) == sorted([15, *(i for i in IDS if i != ELBOW_ID)])


def test_a_second_master_is_heard_and_obeyed(bench):
    bench.mock.inject(Fault("second_master", duration=0.1, value=100.0))
    bench.command(duration=0.005, effort=1.0)
    bench.advance(0.2)
    foreign = [arrival for arrival in bench.log if arrival.frame.arbitration_id >> 24 == 1]
    assert len(foreign) in (14 * 10, 14 * 11)
    assert np.abs(bench.torque()).max() < 1e-3


def test_after_bus_off_nothing_passes_on_that_bus():
    bench = Bench(buses=2)
    bench.enable()
    bench.mock.inject(Fault("bus_off", (ELBOW,)))
    arrivals = bench.mock.advance(bench.mock.time + 0.01)
    assert [(a.bus, a.frame.is_error, a.frame.arbitration_id) for a in arrivals] == [(0, True, 0x40)]
    assert sorted(reply.motor_id for reply in bench.command(duration=0.02)) == [21, 22, 23, 24, 25, 26, 27]
    bench.mock.clear_faults()
    assert len(bench.command(duration=0.02)) == 14


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("stuck", Fault("stuck")),
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
        ("", ["KIND[=VALUE]"]),
        ("silent:left_elbow_pitch@x", ["KIND[=VALUE]"]),
        ("broken", ["broken", "known: silent, late"]),
        ("silent=1.5", ["1.5", "0 to 1"]),
        ("silent=nan", ["nan", "0 to 1"]),
        ("silent:elbow", ["elbow", "left_shoulder_pitch"]),
    ],
)
def test_a_refused_fault_says_why(text, words):
    with pytest.raises(InputError) as refused:
        parse_fault(text, LITE)
    assert all(word in str(refused.value) for word in [f"--fault '{text}'", *words])
