"""Answers and actions of a mock Robstride motor, frame by frame, without a bus and without physics."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mock_rig import ID, Lone, robstride

from humanoid_sim.hardware.can_bus import Frame
from humanoid_sim.hardware.robstride.protocol import (
    CLEAR_FAULTS,
    REPORTS_OFF,
    REPORTS_ON,
    SAVE,
    FaultBit,
    FrameType,
    MotorMode,
    Status,
    StatusFault,
    parameter_data,
)


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


def test_commands_act_only_while_it_is_enabled():
    lone = Lone()
    lone.mit(1.0, 20.0)
    assert lone.motor.drive()[:5] == (0.0, 0.0, 0.0, 0.0, 0.0)
    for _ in range(2):  # the old command does not come back
        assert lone.status(FrameType.ENABLE).mode is MotorMode.RUN
        assert lone.motor.drive()[:5] == (0.0, 0.0, 0.0, 0.0, 0.0), "enabling brings no torque by itself"
        lone.mit(1.0, 20.0)
        assert lone.motor.drive()[:5] == pytest.approx((1.0, 0.0, 0.0, 20.0, 0.0), abs=8e-3)
        assert lone.status(FrameType.STOP).mode is MotorMode.RESET


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


def test_a_reported_position_wraps_and_mechpos_does_not():
    lone = Lone()
    lone.motor.sensed.shaft = 13.0
    assert lone.mit().position == pytest.approx(13.0 - 8 * math.pi, abs=4e-4)
    assert lone.read("mechPos") == pytest.approx(13.0, abs=1e-5)


def test_parameters():
    lone = Lone()
    sensed = lone.motor.sensed
    sensed.velocity, sensed.torque, sensed.voltage = 2.5, 1.7, 47.0
    assert lone.read("mechVel") == pytest.approx(2.5)
    assert lone.read("VBUS") == 47.0
    assert lone.read("iqf") == pytest.approx(1.7 * 23.0 / 17.0, rel=1e-6)
    lone.write("mechPos", 1.0)
    assert lone.read("mechPos") == 0.0, "read only"
    (reply,) = lone.tell(FrameType.READ_PARAMETER, parameter_data(0x7FFF))
    assert not reply.is_success
    lone.tell(FrameType.WRITE_PARAMETER, parameter_data(0x700B, b"\x00\x00\xc0\x7f"))
    assert lone.read("limit_torque") == 17.0, "NaN is not taken"
