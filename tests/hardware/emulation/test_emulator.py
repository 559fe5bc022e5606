"""Motors on emulated buses, driven by frames with times of the test's choosing; no thread and no clock."""

import math

import numpy as np
import pytest
from bus_rig import IDS, LITE, MODELS_BY_ID, Bench

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.emulation.emulator import FrameFaults
from humanoid_sim.hardware.emulation.faults import Fault
from humanoid_sim.hardware.emulation.settings import EmulationSettings
from humanoid_sim.hardware.robstride.codec import decode_command, encode_command
from humanoid_sim.hardware.robstride.messages import (
    DeviceId,
    Enable,
    MotorMode,
    OperationControl,
    Status,
    StatusFault,
    WriteParameter,
)
from humanoid_sim.mit import MITCommand
from humanoid_sim.simulation.mujoco_robot import MujocoRobot

_FRAMES = [Frame(0x02000BFD, bytes([i] * 8)) for i in range(100)]


def _through(faults, motor=0):
    return [arrival for i, frame in enumerate(_FRAMES) for arrival in faults.arrivals(motor, frame, 0.01 * i)]


def _numbers(arrivals):
    return [frame.data[0] for _, frame in arrivals]


@pytest.fixture
def faults():
    return FrameFaults(seed=1)


def test_some_are_lost(faults):
    faults.set("lost", 0, 0.2)
    assert 70 <= len(_through(faults)) <= 90
    assert 50 <= sum(faults.reaches(0) for _ in range(100)) <= 95


def test_they_are_late(faults):
    faults.set("delayed", 0, 0.3)
    assert faults.arrivals(0, _FRAMES[0], 1.0) == [(1.3, _FRAMES[0])]


def test_they_come_twice(faults):
    faults.set("duplicated", 0, 1.0)
    assert _numbers(_through(faults)) == [i for i in range(100) for _ in range(2)]


def test_neighbours_swap_and_none_is_lost(faults):
    faults.set("reordered", 0, 0.5)
    numbers = _numbers(_through(faults))
    faults.set("reordered", 0, None)
    numbers += _numbers(faults.arrivals(0, Frame(0x02000BFD, bytes([100] * 8)), 2.0))
    assert sorted(numbers) == list(range(101))
    assert numbers != sorted(numbers)
    assert max(abs(place - number) for place, number in enumerate(numbers)) == 1


def test_identifiers_and_lengths_are_damaged(faults):
    faults.set("corrupted_id", 0, 27)
    assert {frame.arbitration_id for _, frame in _through(faults)} == {0x0A000BFD}
    faults.set("corrupted_id", 0, None)
    faults.set("corrupted_dlc", 0, 5)
    assert {len(frame.data) for _, frame in _through(faults)} == {5}


ELBOW = "left_elbow_pitch"
ELBOW_ID = 14


@pytest.fixture
def bench():
    """The Lite's motors on one bus, enabled."""
    bench = Bench()
    bench.enable()
    return bench


def test_the_plant_is_that_of_play_fed_with_the_quantised_commands():
    period, steps = 0.005, 60
    bench = Bench()
    bench.enable()
    robot = MujocoRobot(LITE, control_period=period)
    bench.emulator.advance(0.1 + 1e-9)
    for _ in range(20):
        robot.write(MITCommand.zeros(14))
    for step in range(steps):
        wanted = LITE.initial_position + 0.2 * np.sin(0.1 * step * np.ones(14))
        quantised = np.zeros((5, 14))
        for i, joint in enumerate(LITE.joints):
            motor, model = joint.motor, MODELS_BY_ID[IDS[i]]
            turn = bench.turn(i)
            command = OperationControl(motor.can_id, motor.direction * wanted[i] + turn, 0.0, 0.0, 50.0, 2.0)
            frame = encode_command(command, model)
            read = decode_command(frame, motor.can_id, model)
            assert isinstance(read, OperationControl)
            quantised[:, i] = (
                motor.direction * (read.position - turn),
                motor.direction * read.velocity,
                motor.direction * read.effort,
                read.stiffness,
                read.damping,
            )
            bench.emulator.submit(0, frame, bench.emulator.time)
        bench.emulator.advance(0.1 + (step + 1) * period + 1e-9)
        robot.write(MITCommand(*quantised))
    state, _ = robot.read()
    truth = bench.emulator.motors.plant.truth(0.0)
    assert np.abs(state.joint_position - LITE.initial_position).max() > 0.05, "they have moved"
    np.testing.assert_allclose(truth.joint_position, state.joint_position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(truth.joint_effort, state.joint_effort, rtol=0, atol=1e-6)


def test_offsets_and_directions_hide_nothing_but_the_motor_frame():
    offsets = {name: 0.1 * i - 0.5 for i, name in enumerate(LITE.joint_names)}
    bench = Bench(settings=EmulationSettings(homing_offset=offsets))
    for status in bench.ask(Enable):
        assert isinstance(status, Status)
        i = IDS.index(status.motor_id)
        motor = LITE.joints[i].motor
        expected = motor.direction * LITE.initial_position[i] + offsets[LITE.joint_names[i]]
        assert (status.position - expected) / (2 * math.pi) == pytest.approx(
            round((status.position - expected) / (2 * math.pi)), abs=2e-3
        )
        assert -4e-4 <= status.position < 2 * math.pi


def test_the_torque_limit_is_the_written_one(bench):
    wrist = IDS.index(15)
    bench.tell(WriteParameter(15, 0x700B, np.float32(4.0).tobytes()))
    bench.command(duration=0.01, effort=5.0)
    assert abs(bench.torque()[wrist]) == pytest.approx(4.0, rel=1e-6)


def test_work_makes_windings_warm(bench):
    bench.command(duration=1.0, effort=5.0)
    (warm,) = [reply for reply in bench.command(duration=0.02) if reply.motor_id == 15]
    assert 26.0 < warm.temperature < 40.0, "3 times its rated torque for 1 s"


def test_old_firmware_multiplies_the_gains():
    torques = []
    for version in ("0.2.3.5", "0.2.3.6"):
        bench = Bench(settings=EmulationSettings(firmware={"rs-02": version}, stall_time=math.inf))
        bench.enable()
        bench.emulator.motors.plant.jam(0, True)
        bench.submit(OperationControl(11, 6.0, 0.0, 0.0, 10.0, 0.0))
        bench.advance(0.01)
        torques.append(bench.emulator.motors.plant.torque[0])
    assert torques[0] / torques[1] == pytest.approx(1.4167, rel=1e-3)


class TestFaults:
    def test_an_unplugged_motor_boots_when_it_is_plugged_in_again(self):
        bench = Bench(faults=[Fault("unplugged", (ELBOW,), start=0.05, duration=0.2)])
        bench.enable()
        bench.command(duration=0.1, effort=1.0)
        assert bench.torque()[IDS.index(ELBOW_ID)] == 0.0
        assert len(bench.command(duration=0.02)) == 13
        replies = bench.advance(0.2)
        assert [type(reply) for reply in replies] == [DeviceId]
        (status,) = [reply for reply in bench.command(duration=0.02) if reply.motor_id == ELBOW_ID]
        assert status.mode is MotorMode.RESET

    @pytest.mark.parametrize(
        ("kind", "fault"),
        [
            ("over_temperature", StatusFault.MOTOR_OVERTEMPERATURE),
            ("under_voltage", StatusFault.UNDERVOLTAGE),
            ("over_voltage", StatusFault(0)),
            ("overcurrent", StatusFault.PHASE_OVERCURRENT),
            ("stalled", StatusFault.STALL_OVERLOAD),
            ("encoder_fault", StatusFault.ENCODER_FAULT),
            ("reset", StatusFault(0)),
        ],
    )
    def test_a_fault_of_a_motor_stops_it_and_it_does_not_recover(self, kind, fault, bench):
        bench.emulator.inject(Fault(kind, (ELBOW,), duration=0.05))
        for wait in (0.01, 0.1):  # while it lasts, and after it
            bench.advance(wait)
            replies = [reply for reply in bench.command(duration=0.02, effort=1.0) if reply.motor_id == ELBOW_ID]
            assert [(reply.mode, reply.faults) for reply in replies] == [(MotorMode.RESET, fault)]
            assert bench.torque()[IDS.index(ELBOW_ID)] == 0.0

    def test_an_encoder_jump_moves_the_reading_and_the_motor_follows_it(self, bench):
        hold = bench.command(duration=0.02)
        here = {reply.motor_id: reply.position for reply in hold}
        bench.emulator.inject(Fault("encoder_jump", (ELBOW,), value=-0.3))
        bench.emulator.submit(
            0,
            encode_command(OperationControl(ELBOW_ID, here[ELBOW_ID], 0.0, 0.0, 50.0, 2.0), MODELS_BY_ID[ELBOW_ID]),
            bench.emulator.time,
        )
        bench.advance(0.5)
        moved = bench.emulator.motors.plant.truth(0.0).joint_position[IDS.index(ELBOW_ID)]
        assert moved - LITE.initial_position[IDS.index(ELBOW_ID)] == pytest.approx(-0.3, abs=0.05)

    def test_another_master_is_heard_and_obeyed(self, bench):
        bench.emulator.inject(Fault("other_master", duration=0.1, value=100.0))
        bench.command(duration=0.005, effort=1.0)
        frames = [arrival.frame for arrival in bench.emulator.advance(bench.emulator.time + 0.2)]
        foreign = [frame for frame in frames if frame.arbitration_id >> 24 == 1]
        assert len(foreign) in (14 * 9, 14 * 10)
        assert np.abs(bench.torque()).max() < 1e-3

    def test_bus_off_is_said_once_and_then_nothing_passes(self):
        bench = Bench(buses=2)
        bench.enable()
        bench.emulator.inject(Fault("bus_off", (ELBOW,)))
        arrivals = bench.emulator.advance(bench.emulator.time + 0.01)
        assert [(arrival.bus, arrival.frame.is_error, arrival.frame.arbitration_id) for arrival in arrivals] == [
            (0, True, 0x40)
        ]
        assert (bench.emulator.host_fault(0), bench.emulator.host_fault(1)) == ("bus_off", "")
        replies = bench.command(duration=0.02)
        assert sorted(reply.motor_id for reply in replies) == [21, 22, 23, 24, 25, 26, 27]


def test_the_same_frames_and_faults_give_the_same_answers():
    def run():
        bench = Bench(faults=[Fault("lost", value=0.3), Fault("reordered", ("left_wrist_yaw",))])
        bench.ask(Enable)
        for step in range(20):
            bench.command(duration=0.005, effort=0.1 * step)
        return [(arrival.time, arrival.frame) for arrival in bench.log]

    first = run()
    assert first == run()
    assert len(first) > 100
