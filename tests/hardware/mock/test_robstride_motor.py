"""Answers and actions of a mock Robstride motor, frame by frame, without a bus and without physics."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.hardware.can_bus import Frame
from humanoid_sim.hardware.mock.robstride_motor import RobstrideMotor
from humanoid_sim.hardware.robstride import protocol
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, pack_value, unpack_value
from humanoid_sim.hardware.robstride.protocol import FaultBit, FrameType, MotorMode, Status, StatusFault
from humanoid_sim.robots.motors import MOTORS

ID = 11


class Lone:
    """An rs-02 whose sensors the test sets, and that answers in messages."""

    def __init__(self, shaft=0.0, *, enabled=False):
        self.motor, self.time = RobstrideMotor(MOTORS["rs-02"], ID, bytes(range(8))), 0.0
        self.motor.sensed.shaft = shaft
        self.motor.power_on()
        if enabled:
            assert self.ask(FrameType.ENABLE).mode is MotorMode.RUN

    def ask(self, kind, data=b""):
        """The answer to a command."""
        (reply,) = self._read(self.motor.receive(protocol.encode_command(kind, ID, data), self.time))
        return reply

    def wait(self, duration):
        """What comes while the motor looks after itself every ms."""
        replies = []
        for _ in range(round(duration / 0.001)):
            self.time += 0.001
            replies += self._read(self.motor.advance(self.time))
        return replies

    def mit(self):
        """The status that answers operation control without torque."""
        command = protocol.encode_operation(ID, protocol.OperationControl(0.0, 0.0, 0.0, 0.0, 0.0), self.motor.model)
        (status,) = self._read(self.motor.receive(command, self.time))
        return status

    def write(self, name, value):
        parameter = PARAMETERS[name]
        self.ask(FrameType.WRITE_PARAMETER, protocol.parameter_data(parameter.index, pack_value(parameter.type, value)))

    def read(self, name):
        parameter = PARAMETERS[name]
        reply = self.ask(FrameType.READ_PARAMETER, protocol.parameter_data(parameter.index))
        assert reply.is_success
        return unpack_value(parameter.type, reply.payload)

    def _read(self, frames):
        return [protocol.decode_reply(frame, {ID: self.motor.model}, self.motor.host_id) for frame in frames]


def test_after_power_on_it_is_disabled_and_knows_its_angle_within_one_turn():
    lone = Lone(-0.13)
    status = lone.mit()
    assert status.mode is MotorMode.RESET
    assert status.position == pytest.approx(2 * math.pi - 0.13, abs=4e-4)
    assert Lone(0.13 + 14 * math.pi).mit().position == pytest.approx(0.13, abs=4e-4)
    lone.write("zero_sta", 1)
    lone.write("limit_torque", 3.0)
    lone.ask(FrameType.SAVE_PARAMETERS, protocol.SAVE)
    lone.write("limit_torque", 4.0)
    lone.motor.power_on()
    assert lone.mit().position == pytest.approx(-0.13, abs=4e-4)
    assert lone.read("limit_torque") == 3.0, "unsaved values are lost without power"


@given(st.integers(0, (1 << 29) - 1), st.binary(max_size=8), st.booleans(), st.booleans())
def test_no_frame_makes_it_fail(number, data, extended, addressed):
    motor = Lone(enabled=True).motor
    number = number & ~0xFF | ID if addressed else number
    assert len(motor.receive(Frame(number if extended else number & 0x7FF, data, extended), 1.0)) <= 1
    motor.advance(2.0)


def test_the_can_timeout_stops_it_without_a_fault_bit():
    lone = Lone(enabled=True)
    lone.write("canTimeout", 2000)
    lone.wait(0.098)
    lone.mit()
    lone.wait(0.099)
    assert lone.motor.is_running, "a command restarts it"
    lone.wait(0.002)
    status = lone.mit()
    assert (status.mode, status.faults) == (MotorMode.RESET, StatusFault(0))


@pytest.mark.parametrize(
    ("sensor", "value", "in_status", "in_report"),
    [
        ("temperature", 136.0, StatusFault.MOTOR_OVERTEMPERATURE, FaultBit.MOTOR_OVERTEMPERATURE),
        ("voltage", 11.0, StatusFault.UNDERVOLTAGE, FaultBit.UNDERVOLTAGE),
        ("overcurrent", True, StatusFault.PHASE_OVERCURRENT, FaultBit.PHASE_A_OVERCURRENT),
    ],
)
def test_a_fault_stops_it_and_is_latched_until_it_is_cleared_without_its_cause(sensor, value, in_status, in_report):
    lone = Lone(enabled=True)
    healthy = getattr(lone.motor.sensed, sensor)
    setattr(lone.motor.sensed, sensor, value)
    assert [report.faults for report in lone.wait(0.003)] == [in_report]
    status = lone.mit()
    assert (status.mode, status.faults) == (MotorMode.RESET, in_status)
    assert lone.ask(FrameType.ENABLE).mode is MotorMode.RESET
    assert lone.ask(FrameType.STOP, protocol.CLEAR_FAULTS).faults == in_status, "the cause is still there"
    setattr(lone.motor.sensed, sensor, healthy)
    lone.wait(0.1)
    assert lone.ask(FrameType.STOP).faults == in_status, "latched"
    assert lone.ask(FrameType.STOP, protocol.CLEAR_FAULTS).faults == StatusFault(0)
    assert lone.ask(FrameType.ENABLE).mode is MotorMode.RUN


def test_active_reports_have_their_interval():
    lone = Lone(enabled=True)
    lone.write("EPScan_time", 3)
    lone.ask(FrameType.ACTIVE_REPORT, protocol.REPORTS_ON)
    reports = lone.wait(0.1)
    assert len(reports) == 5, "every 20 ms"
    assert all(isinstance(report, Status) and report.is_report for report in reports)
    lone.ask(FrameType.ACTIVE_REPORT, protocol.REPORTS_OFF)
    assert lone.wait(0.1) == []


def test_measurements_are_parameters_and_the_position_wraps_in_a_status_only():
    lone = Lone()
    sensed = lone.motor.sensed
    sensed.shaft, sensed.velocity, sensed.torque, sensed.voltage = 13.0, 2.5, 1.7, 47.0
    assert lone.mit().position == pytest.approx(13.0 - 8 * math.pi, abs=4e-4)
    lone.write("mechPos", 1.0)  # read only
    assert [lone.read(name) for name in ("mechPos", "mechVel", "VBUS")] == pytest.approx([13.0, 2.5, 47.0])
    assert lone.read("iqf") == pytest.approx(1.7 * 23.0 / 17.0, rel=1e-6)
    reply = lone.ask(FrameType.READ_PARAMETER, protocol.parameter_data(0x7FFF))
    assert not reply.is_success
    lone.ask(FrameType.WRITE_PARAMETER, protocol.parameter_data(0x700B, b"\x00\x00\xc0\x7f"))
    assert lone.read("limit_torque") == 17.0, "NaN is not taken"
