"""Answers and actions of a mock Robstride motor, frame by frame, without a bus and without physics."""

import math
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.hardware.can_bus import Frame
from humanoid_sim.hardware.mock.robstride_motor import RobstrideMotor
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, pack_value, unpack_value
from humanoid_sim.hardware.robstride.protocol import (
    CLEAR_FAULTS,
    REPORTS_OFF,
    REPORTS_ON,
    SAVE,
    FaultBit,
    FrameType,
    MotorMode,
    OperationControl,
    ParameterReply,
    Reply,
    Status,
    StatusFault,
    decode_reply,
    encode_command,
    encode_operation,
    parameter_data,
)
from humanoid_sim.robots.motors import MOTORS

ID = 11


def robstride(shaft: float = 0.0) -> RobstrideMotor:
    motor = RobstrideMotor(MOTORS["rs-02"], ID, bytes(range(8)))
    motor.sensed.shaft = shaft
    motor.power_on()
    return motor


@dataclass
class Lone:
    """An rs-02 whose sensors the test sets, and that answers in messages."""

    motor: RobstrideMotor = field(default_factory=robstride)
    time: float = 0.0

    def tell(self, kind: FrameType, data: bytes = b"") -> list[Reply]:
        return self._read(self.motor.receive(encode_command(kind, self.motor.can_id, data), self.time))

    def wait(self, duration: float) -> list[Reply]:
        """Let the motor look after itself every ms."""
        replies = []
        for _ in range(round(duration / 0.001)):
            self.time += 0.001
            replies += self._read(self.motor.advance(self.time))
        return replies

    def status(self, kind: FrameType, data: bytes = b"") -> Status:
        (reply,) = self.tell(kind, data)
        assert isinstance(reply, Status)
        return reply

    def mit(self, position: float = 0.0, stiffness: float = 0.0, effort: float = 0.0) -> Status:
        command = OperationControl(position, 0.0, effort, stiffness, 0.0)
        (reply,) = self._read(self.motor.receive(encode_operation(ID, command, self.motor.model), self.time))
        assert isinstance(reply, Status)
        return reply

    def write(self, name: str, value: float) -> Status:
        parameter = PARAMETERS[name]
        data = parameter_data(parameter.index, pack_value(parameter.type, value))
        return self.status(FrameType.WRITE_PARAMETER, data)

    def read(self, name: str) -> float:
        parameter = PARAMETERS[name]
        (reply,) = self.tell(FrameType.READ_PARAMETER, parameter_data(parameter.index))
        assert isinstance(reply, ParameterReply)
        assert reply.is_success
        return unpack_value(parameter.type, reply.payload)

    def _read(self, frames) -> list[Reply]:
        models = dict.fromkeys(range(1, 128), self.motor.model)
        replies = [decode_reply(frame, models, self.motor.host_id) for frame in frames]
        assert all(isinstance(reply, Reply) for reply in replies)
        return replies


def enabled(shaft=0.0):
    lone = Lone(robstride(shaft))
    assert lone.status(FrameType.ENABLE).mode is MotorMode.RUN
    return lone


def test_after_power_on_it_is_disabled_and_knows_its_angle_within_one_turn():
    lone = Lone(robstride(shaft=-0.13))
    status = lone.mit()
    assert status.mode is MotorMode.RESET
    assert status.position == pytest.approx(2 * math.pi - 0.13, abs=4e-4)
    assert Lone(robstride(shaft=0.13 + 14 * math.pi)).mit().position == pytest.approx(0.13, abs=4e-4)
    lone.write("zero_sta", 1)
    lone.write("limit_torque", 3.0)
    lone.tell(FrameType.SAVE_PARAMETERS, SAVE)
    lone.write("limit_torque", 4.0)
    lone.motor.power_on()
    assert lone.mit().position == pytest.approx(-0.13, abs=4e-4)
    assert lone.read("limit_torque") == 3.0, "unsaved values are lost without power"


@given(st.integers(0, (1 << 29) - 1), st.binary(max_size=8), st.booleans(), st.booleans())
def test_no_frame_makes_it_fail(number, data, extended, addressed):
    motor = enabled().motor
    number = number & ~0xFF | ID if addressed else number
    assert len(motor.receive(Frame(number if extended else number & 0x7FF, data, extended), 1.0)) <= 1
    motor.advance(2.0)


def test_the_can_timeout_stops_it_without_a_fault_bit():
    lone = enabled()
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
    lone = enabled()
    healthy = getattr(lone.motor.sensed, sensor)
    setattr(lone.motor.sensed, sensor, value)
    assert [report.faults for report in lone.wait(0.003)] == [in_report]
    status = lone.mit(effort=1.0)
    assert (status.mode, status.faults) == (MotorMode.RESET, in_status)
    assert lone.status(FrameType.ENABLE).mode is MotorMode.RESET
    assert lone.status(FrameType.STOP, CLEAR_FAULTS).faults == in_status, "the cause is still there"
    setattr(lone.motor.sensed, sensor, healthy)
    lone.wait(0.1)
    assert lone.status(FrameType.STOP).faults == in_status, "latched"
    assert lone.status(FrameType.STOP, CLEAR_FAULTS).faults == StatusFault(0)
    assert lone.status(FrameType.ENABLE).mode is MotorMode.RUN


def test_active_reports_have_their_interval():
    lone = enabled()
    lone.write("EPScan_time", 3)
    lone.tell(FrameType.ACTIVE_REPORT, REPORTS_ON)
    reports = lone.wait(0.1)
    assert len(reports) == 5, "every 20 ms"
    assert all(isinstance(report, Status) and report.is_report for report in reports)
    lone.tell(FrameType.ACTIVE_REPORT, REPORTS_OFF)
    assert lone.wait(0.1) == []


def test_measurements_are_parameters_and_the_position_wraps_in_a_status_only():
    lone = Lone()
    sensed = lone.motor.sensed
    sensed.shaft, sensed.velocity, sensed.torque, sensed.voltage = 13.0, 2.5, 1.7, 47.0
    assert lone.mit().position == pytest.approx(13.0 - 8 * math.pi, abs=4e-4)
    lone.write("mechPos", 1.0)  # read only
    assert [lone.read(name) for name in ("mechPos", "mechVel", "VBUS")] == pytest.approx([13.0, 2.5, 47.0])
    assert lone.read("iqf") == pytest.approx(1.7 * 23.0 / 17.0, rel=1e-6)
    (reply,) = lone.tell(FrameType.READ_PARAMETER, parameter_data(0x7FFF))
    assert not reply.is_success
    lone.tell(FrameType.WRITE_PARAMETER, parameter_data(0x700B, b"\x00\x00\xc0\x7f"))
    assert lone.read("limit_torque") == 17.0, "NaN is not taken"
