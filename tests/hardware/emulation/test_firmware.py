"""What an emulated motor answers and does, frame by frame, without a bus and without physics."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from motor_rig import ID, Motor, fault_reports, identity

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.emulated_motor import Sensed
from humanoid_sim.hardware.robstride import messages
from humanoid_sim.hardware.robstride.messages import FaultBit, MotorMode, StatusFault


def _enabled(model="rs-02", version=None, shaft=0.0):
    motor = Motor(identity(model, version), Sensed(shaft))
    assert motor.status(messages.Enable(ID)).mode is MotorMode.RUN
    return motor


def test_after_power_on_it_is_not_enabled_and_knows_its_angle_within_one_turn_only():
    motor = Motor(sensed=Sensed(-0.13))
    status = motor.mit()
    assert status.mode is MotorMode.RESET
    assert status.position == pytest.approx(2 * math.pi - 0.13, abs=4e-4)
    motor = Motor(sensed=Sensed(0.13 + 14 * math.pi))
    assert motor.mit().position == pytest.approx(0.13, abs=4e-4)


def test_a_saved_zero_sta_makes_the_first_position_lie_around_zero():
    motor = Motor(sensed=Sensed(-0.13))
    motor.write("zero_sta", 1)
    motor.tell(messages.SaveParameters(ID))
    motor.cycle_power()
    assert motor.mit().position == pytest.approx(-0.13, abs=4e-4)


def test_what_is_not_saved_is_lost_without_power():
    motor = Motor()
    motor.write("limit_torque", 3.0)
    assert motor.read("limit_torque") == 3.0
    motor.cycle_power()
    assert motor.read("limit_torque") == 17.0


def test_commands_are_obeyed_only_while_enabled():
    motor = Motor()
    motor.mit(1.0, 20.0)
    assert motor.state.command is None
    assert motor.status(messages.Enable(ID)).mode is MotorMode.RUN
    assert motor.state.command is None, "enabling brings no torque by itself"
    motor.mit(1.0, 20.0)
    command = motor.state.command
    assert command.position == pytest.approx(1.0, abs=4e-4)
    assert command.stiffness == pytest.approx(20.0, abs=8e-3)
    assert motor.status(messages.Stop(ID)).mode is MotorMode.RESET
    assert motor.state.command is None
    assert motor.status(messages.Enable(ID)).mode is MotorMode.RUN
    assert motor.state.command is None, "the old command does not come back"


@given(st.integers(0, (1 << 29) - 1), st.binary(max_size=8), st.booleans(), st.booleans())
def test_no_frame_makes_it_fail(number, data, extended, addressed):
    motor = _enabled()
    number = number & ~0xFF | ID if addressed else number
    frame = Frame(number if extended else number & 0x7FF, data, extended)
    reaction = motor.receive(frame, 1.0)
    assert len(reaction.frames) <= 1
    again = motor.firmware.advance(reaction.state, motor.sensed, 2.0)
    assert again.state.mode in (MotorMode.RESET, MotorMode.RUN)


def test_the_can_timeout_drops_it_to_reset_mode_without_a_fault_bit():
    motor = _enabled()
    motor.write("canTimeout", 2000)
    motor.wait(0.098)
    assert motor.state.is_running
    motor.mit()
    motor.wait(0.099)
    assert motor.state.is_running, "a command restarts it"
    motor.wait(0.002)
    status = motor.mit()
    assert (status.mode, status.faults) == (MotorMode.RESET, StatusFault(0))
    assert motor.state.is_running is False, "and it stays so"


@pytest.mark.parametrize(
    ("feeling", "in_status", "in_report"),
    [
        ({"temperature": 136.0}, StatusFault.MOTOR_OVERTEMPERATURE, FaultBit.MOTOR_OVERTEMPERATURE),
        ({"voltage": 11.0}, StatusFault.UNDERVOLTAGE, FaultBit.UNDERVOLTAGE),
        ({"voltage": 61.0}, StatusFault(0), FaultBit.OVERVOLTAGE),
        ({"encoder_fault": True}, StatusFault.ENCODER_FAULT, FaultBit(0)),
        ({"overcurrent": True}, StatusFault.PHASE_OVERCURRENT, FaultBit.PHASE_A_OVERCURRENT),
        ({"overloaded": True}, StatusFault.STALL_OVERLOAD, FaultBit.STALL_OVERLOAD),
    ],
)
def test_a_fault_stops_it_is_latched_and_cleared_only_when_its_cause_is_gone(feeling, in_status, in_report):
    motor = _enabled()
    healthy = motor.sensed
    motor.feel(**feeling)
    reports = fault_reports(motor.wait(0.003))
    assert [report.faults for report in reports] == ([in_report] if in_report else [])
    status = motor.mit(effort=1.0)
    assert (status.mode, status.faults) == (MotorMode.RESET, in_status)

    assert motor.status(messages.Enable(ID)).mode is MotorMode.RESET, "a faulted motor is not enabled"
    assert motor.status(messages.Stop(ID, clear_fault=True)).faults == in_status, "the cause is still there"
    motor.sensed = healthy
    cooled = bool(in_report & FaultBit.MOTOR_OVERTEMPERATURE)  # the warning ends with its cause, and that is reported
    assert len(motor.wait(0.1)) == cooled
    assert motor.mit().faults == in_status, "latched"
    assert motor.status(messages.Stop(ID)).faults == in_status
    assert motor.status(messages.Stop(ID, clear_fault=True)).faults == StatusFault(0)
    assert motor.state.faults == FaultBit(0)
    assert motor.status(messages.Enable(ID)).mode is MotorMode.RUN


def test_full_torque_without_motion_trips_the_overload_protection_after_a_while():
    motor = _enabled()
    motor.write("limit_torque", 4.0)
    motor.feel(torque=4.0)
    motor.wait(1.9)
    assert motor.state.is_running
    motor.feel(velocity=1.0)
    motor.wait(0.2)
    motor.feel(velocity=0.0)
    motor.wait(1.9)
    assert motor.state.is_running, "motion starts the time afresh"
    motor.wait(0.2)
    assert motor.mit().faults == StatusFault.STALL_OVERLOAD


def test_active_reports():
    motor = _enabled()
    motor.write("EPScan_time", 3)
    motor.tell(messages.SetActiveReport(ID, True))
    reports = motor.wait(0.1)
    assert len(reports) == 5, "every 20 ms"
    assert all(isinstance(report, messages.Status) and report.is_report for report in reports)
    motor.tell(messages.SetActiveReport(ID, False))
    assert motor.wait(0.1) == []


def test_set_zero_makes_here_zero_and_moves_the_target_unless_the_firmware_is_old():
    motor = _enabled(shaft=1.5)
    motor.mit(1.5, 50.0)
    assert motor.status(messages.SetZero(ID)).position == pytest.approx(0.0, abs=4e-4)
    assert motor.state.command.position == 0.0

    motor = _enabled(version="0.2.2.11", shaft=1.5)
    motor.mit(1.5, 50.0)
    motor.tell(messages.SetZero(ID))
    assert motor.state.command.position == pytest.approx(1.5, abs=4e-4), "it will jump"


def test_position_feedback_runs_cyclically_and_mechpos_does_not():
    motor = Motor()
    motor.feel(shaft=13.0)
    assert motor.mit().position == pytest.approx(13.0 - 8 * math.pi, abs=4e-4)
    assert motor.read("mechPos") == pytest.approx(13.0, abs=1e-5)
    old = Motor(identity(version="0.2.2.11"))
    old.feel(shaft=12.55)
    reaction = old.receive(Frame(0x017FFF0B, bytes(8)))
    raw = int.from_bytes(reaction.frames[0].data[:2], "big")
    assert (raw / 32767 - 1) * 12.5 == pytest.approx(12.55 - 25.0, abs=4e-4)


def test_reading_and_writing_parameters():
    motor = Motor()
    motor.feel(velocity=2.5, torque=1.7, voltage=47.0)
    assert motor.read("mechVel") == pytest.approx(2.5)
    assert motor.read("VBUS") == 47.0
    assert motor.read("iqf") == pytest.approx(1.7 * 23.0 / 17.0, rel=1e-6)
    assert motor.read("canTimeout") == 0
    motor.write("mechPos", 1.0)
    assert motor.read("mechPos") == 0.0, "read only"
    motor.write("run_mode", 9)
    assert motor.read("run_mode") == 0
    (reply,) = motor.tell(messages.ReadParameter(ID, 0x7FFF))
    assert isinstance(reply, messages.ParameterReply)
    assert not reply.is_success
    motor.tell(messages.WriteParameter(ID, 0x700B, b"\x00\x00\xc0\x7f"))
    assert motor.read("limit_torque") == 17.0, "NaN is not taken"


_COMMANDS = st.one_of(
    st.just(messages.Enable(ID)),
    st.builds(messages.Stop, st.just(ID), st.booleans()),
    st.builds(
        messages.OperationControl,
        st.just(ID),
        st.floats(-13.0, 13.0),
        st.floats(-44.0, 44.0),
        st.floats(-17.0, 17.0),
        st.floats(0.0, 500.0),
        st.floats(0.0, 5.0),
    ),
    st.just(messages.GetDeviceId(ID)),
    st.just(messages.SetZero(ID)),
    st.just(messages.SaveParameters(ID)),
    st.builds(messages.SetActiveReport, st.just(ID), st.booleans()),
    st.builds(messages.ReadParameter, st.just(ID), st.integers(0x7000, 0x7030)),
    st.builds(
        messages.WriteParameter,
        st.just(ID),
        st.sampled_from([0x7005, 0x700B, 0x7026, 0x7028]),
        st.binary(min_size=4, max_size=4),
    ),
)
_FEELINGS = st.fixed_dictionaries(
    {},
    optional={
        "shaft": st.floats(-30.0, 30.0),
        "temperature": st.floats(0.0, 200.0),
        "voltage": st.floats(0.0, 70.0),
        "encoder_fault": st.booleans(),
        "overcurrent": st.booleans(),
    },
)
_EVENTS = st.lists(st.one_of(_COMMANDS, _FEELINGS, st.floats(0.001, 0.05)), max_size=20)


@given(_EVENTS)
def test_only_an_enable_enables_a_faulty_motor_never_runs_and_only_a_running_one_has_a_target(events):
    motor = Motor()
    for event in events:
        was_running = motor.state.is_running
        if isinstance(event, dict):
            motor.feel(**event)
            motor.wait(0.001)
        elif isinstance(event, float):
            motor.wait(event)
        else:
            motor.tell(event)
        state = motor.state
        if state.is_running and not was_running:
            assert isinstance(event, messages.Enable)
        assert state.mode in (MotorMode.RESET, MotorMode.RUN)
        assert not (state.is_running and (state.status_faults or state.faults))
        assert state.command is None or state.is_running
        assert 0.0 <= motor.mit().temperature <= 200.1
