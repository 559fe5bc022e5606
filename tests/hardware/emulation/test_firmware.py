"""What an emulated motor answers and does, frame by frame, without a bus and without physics."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from motor_rig import HOST, ID, Motor, fault_reports, identity

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.emulated_motor import Reaction, Sensed
from humanoid_sim.hardware.emulation import firmware
from humanoid_sim.hardware.robstride import messages
from humanoid_sim.hardware.robstride.codec import encode_command
from humanoid_sim.hardware.robstride.messages import FaultBit, MotorMode, StatusFault, WarningBit


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


def test_it_answers_whoever_asked_last_because_type_1_has_no_room_for_a_host():
    motor = Motor()
    motor.tell(messages.Enable(ID, host_id=0xAA))
    assert motor.mit().host_id == 0xAA
    motor.tell(messages.GetDeviceId(ID, host_id=HOST))
    assert motor.mit().host_id == HOST


def test_identity_and_version():
    motor = Motor()
    assert motor.tell(messages.GetDeviceId(ID)) == [messages.DeviceId(ID, bytes(range(8)))]
    (frame,) = motor.receive(Frame(0x0400FD0B, b"\0\xc4" + bytes(6))).frames
    assert frame.data == bytes.fromhex("00C4560002030900")
    assert motor.tell(messages.ReadVersion(ID)), "it is answered like any command"


def test_frames_for_others_and_malformed_ones_change_nothing():
    motor = _enabled()
    before = motor.state
    for frame in (
        Frame(0x0300FD0C, bytes(8)),
        Frame(0x0400FD0B, bytes(8), is_extended=False),
        Frame(0x0400FD0B, b"", is_remote=True),
        Frame(0x017FFF0B, bytes(7)),
        Frame(0x1300FD0B, bytes(8)),
    ):
        assert motor.receive(frame, 1.0) == Reaction(before)


@given(st.integers(0, (1 << 29) - 1), st.binary(max_size=8), st.booleans(), st.booleans())
def test_no_frame_makes_it_fail(number, data, extended, addressed):
    motor = _enabled()
    number = number & ~0xFF | ID if addressed else number
    frame = Frame(number if extended else number & 0x7FF, data, extended)
    reaction = motor.receive(frame, 1.0)
    assert len(reaction.frames) <= 1
    again = motor.firmware.advance(reaction.state, motor.sensed, 2.0)
    assert again.state.mode in (MotorMode.RESET, MotorMode.RUN)


def test_the_can_timeout_is_off_by_default():
    motor = _enabled()
    motor.mit(effort=1.0)
    motor.wait(10.0)
    assert motor.state.is_running
    assert motor.state.command is not None


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


def test_it_warns_before_it_is_too_hot():
    motor = _enabled("rs-00")
    motor.feel(temperature=136.0)
    (report,) = fault_reports(motor.wait(0.003))
    assert (report.faults, report.warnings) == (FaultBit(0), WarningBit.MOTOR_OVERTEMPERATURE_WARNING)
    assert motor.mit().mode is MotorMode.RUN
    motor.feel(temperature=80.0)
    (report,) = fault_reports(motor.wait(0.003))
    assert (report.faults, report.warnings) == (FaultBit(0), WarningBit(0))


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


def test_older_firmware_reports_as_type_2_and_still_older_does_not_know_the_command():
    motor = _enabled("rs-00", "0.0.3.1")
    motor.tell(messages.SetActiveReport(ID, True))
    reports = motor.wait(0.03)
    assert len(reports) == 3
    assert not any(report.is_report for report in reports if isinstance(report, messages.Status))
    motor = _enabled("rs-00", "0.0.2.9")
    assert motor.tell(messages.SetActiveReport(ID, True)) == []
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


def test_set_zero_is_ignored_in_profile_position_mode():
    motor = Motor(sensed=Sensed(1.5))
    motor.write("run_mode", 1)
    assert motor.status(messages.SetZero(ID)).position == pytest.approx(1.5, abs=4e-4)


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


@pytest.mark.parametrize(
    "command", [messages.SetProtocol(ID, messages.Protocol.MIT), messages.SetBaudRate(ID, messages.BaudRate.KBIT_500)]
)
def test_another_protocol_or_bit_rate_makes_it_unreachable_after_the_next_power_on(command):
    motor = Motor()
    assert isinstance(motor.tell(command)[0], messages.DeviceId)
    assert motor.tell(messages.GetDeviceId(ID)) != []
    motor.cycle_power()
    assert motor.tell(messages.GetDeviceId(ID)) == []


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


@pytest.mark.parametrize("mode", [1, 2, 3, 5])
def test_a_run_mode_that_is_not_emulated_is_not_enabled(mode):
    motor = Motor()
    motor.write("run_mode", mode)
    frame = encode_command(messages.Enable(ID), motor.identity.model)
    reaction = motor.receive(frame)
    assert reaction.refusal == f"not enabled: run_mode is {mode}, only 0 (operation) is emulated"
    status = motor.status(messages.Enable(ID))
    assert (status.mode, int(status.faults)) == (MotorMode.RESET, 0), "like one with a latched fault, without its bit"
    motor.write("run_mode", 0)
    assert motor.status(messages.Enable(ID)).mode is MotorMode.RUN


def test_the_run_mode_stays_while_it_runs():
    motor = _enabled()
    motor.write("run_mode", 2)
    assert motor.read("run_mode") == 0


def test_the_fault_word_can_be_read():
    motor = Motor()
    motor.feel(voltage=61.0)
    motor.wait(0.002)
    (reply,) = motor.tell(messages.ReadParameter(ID, 0x3022))
    assert isinstance(reply, messages.ParameterReply)
    assert int.from_bytes(reply.payload, "little") == FaultBit.OVERVOLTAGE


@pytest.mark.parametrize(
    ("model", "position", "torque"), [("rs-02", 0x3016, 0x302C), ("rs-04", 0x3017, 0x302C), ("rs-06", 0x3016, 0x302D)]
)
def test_measurements_can_be_read_by_their_function_codes_too(model, position, torque):
    motor = Motor(identity(model))
    motor.feel(shaft=1.5, velocity=0.5, torque=2.0)
    for index, value in ((position, 1.5), (position + 1, 0.5), (torque, 2.0)):
        (reply,) = motor.tell(messages.ReadParameter(ID, index))
        assert isinstance(reply, messages.ParameterReply)
        assert reply.payload == np.float32(value).tobytes()


def test_parameters_that_came_with_newer_firmware():
    for version, is_there in (("0.2.3.9", True), ("0.2.2.9", False)):
        (reply,) = Motor(identity(version=version)).tell(messages.ReadParameter(ID, 0x702B))
        assert isinstance(reply, messages.ParameterReply)
        assert reply.is_success is is_there


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


@given(_EVENTS, st.integers(1, 1000))
def test_silence_for_longer_than_the_can_timeout_always_ends_in_reset_mode(events, ticks):
    motor = Motor()
    for event in events:
        if not isinstance(event, dict | float):
            motor.tell(event)
    motor.write("canTimeout", ticks)
    motor.tell(messages.Enable(ID))
    motor.mit(effort=1.0)
    motor.wait(50e-6 * ticks + 0.002)
    assert motor.state.mode is MotorMode.RESET
    assert motor.state.command is None


@given(st.floats(-1e3, 1e3), st.sampled_from([12.5, 4 * math.pi]))
def test_wrapping_keeps_the_angle_up_to_whole_ranges(position, limit):
    found = firmware.wrapped(position, limit)
    assert -limit <= found <= limit
    turns = (position - found) / (2 * limit)
    assert turns == pytest.approx(round(turns), abs=1e-9)
