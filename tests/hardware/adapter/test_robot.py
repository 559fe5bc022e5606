"""What an enabled robot does with what happens on its buses."""

import errno
import random
import re
import time

import can
import numpy as np
import pytest
from scripted_motors import fault_report
from test_motor_table import random_frame
from waiting import wait_until

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.bus.address import open_bus
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.robstride.codec import encode_command
from humanoid_sim.hardware.robstride.messages import (
    Enable,
    FaultBit,
    GetDeviceId,
    MotorMode,
    OperationControl,
    StatusFault,
    Stop,
    WarningBit,
    join_identifier,
)
from humanoid_sim.messages import SafetyFlag, SafetyLevel
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.motors import MOTORS

FAULT, WARNING = SafetyLevel.FAULT, SafetyLevel.WARNING
THEN = ", then press e (or: mode reactivate)"
STOOD_STILL = r"find out why this program stood still for \d+\.\d s"


@pytest.fixture
def enabled(robot, left, right):
    """The pair, enabled, its motors' memory of that empty."""
    robot.activate()
    for motor in (left, right):
        motor.heard.clear()
    return robot


def _hold(stiffness=50.0, damping=2.0):
    return MITCommand(np.array([-0.2, 0.4]), np.zeros(2), np.zeros(2), np.full(2, stiffness), np.full(2, damping))


def _statuses(robot):
    return robot.read()[1]


def _wait_for(robot, flags, channel=0):
    """The first status of a channel with these flags; the other channel stays OK."""
    assert wait_until(lambda: _statuses(robot)[channel].flags == flags), _statuses(robot)
    statuses = _statuses(robot)
    assert statuses[1 - channel].is_ok
    return statuses[channel]


def test_a_command_that_could_not_leave_within_two_periods_never_does(enabled, monkeypatch):
    """By then there are newer ones, or none because the program stood still."""
    given = []
    with monkeypatch.context() as patch:
        for channel in enabled._motors.line.channels:
            patch.setattr(channel, "send", lambda batch, lifetime: given.append((len(batch), lifetime)))
        enabled.write(_hold())
    assert given == [(1, 2.0 * enabled.control_period)] * 2


def test_a_command_reaches_each_motor_in_its_own_frame(enabled, left, right):
    enabled.write(_hold())
    assert wait_until(lambda: bool(left.commands and right.commands))
    assert left.commands[0].position == pytest.approx(0.2, abs=4e-4)
    assert right.commands[0].position == pytest.approx(0.4, abs=4e-4)
    assert left.commands[0].stiffness == pytest.approx(50.0, abs=1e-2)
    assert wait_until(lambda: enabled.statistics.acknowledged == 2)
    assert enabled.statistics.commanded == 2


def test_a_command_that_is_not_finite_becomes_damping_and_is_told(enabled, left):
    command = _hold()
    enabled.write(
        MITCommand(
            np.array([np.nan, 0.0]),
            *(getattr(command, name) for name in ("velocity", "effort", "stiffness", "damping")),
        )
    )
    assert wait_until(lambda: bool(left.commands))
    assert (left.commands[0].stiffness, left.commands[0].effort) == (0.0, 0.0)
    assert left.commands[0].damping == pytest.approx(3.0, abs=1e-3)
    status = _statuses(enabled)[-1]
    assert (status.level, status.source) == (SafetyLevel.CRITICAL, "host")
    assert enabled.statistics.refused == 1


def test_a_command_for_another_robot_raises(enabled):
    with pytest.raises(RobotError, match=r"command has shape \(3,\), expected \(2,\)"):
        enabled.write(MITCommand.zeros(3))


def test_nothing_is_sent_to_motors_that_are_not_enabled(robot, left):
    robot.write(_hold())
    robot.prepare()
    left.heard.clear()
    robot.write(_hold())
    time.sleep(0.02)
    assert left.commands == []
    assert robot.statistics.refused == 1


def test_before_anything_was_heard_nothing_is_known(robot):
    state, statuses = robot.read()
    assert np.isnan(state.joint_position).all()
    assert np.isinf(state.joint_age).all()
    assert state.joint_velocity.tolist() == state.joint_effort.tolist() == [0.0, 0.0]
    assert [(status.level, status.flags, status.message) for status in statuses] == [
        (FAULT, SafetyFlag.BUS_OFF, "not activated")
    ] * 2


def test_what_does_not_fit_is_counted_and_shown(enabled, left):
    enabled.write(_hold(damping=6.0))
    beyond = ([-0.2, 30.0], [50.0, 0.0], [18.0, 0.0], [501.0, 0.0], [5.1, 0.0])
    enabled.write(MITCommand(*map(np.array, beyond)))
    enabled.write(MITCommand(np.array([1.0, 0.4]), np.zeros(2), np.zeros(2), np.full(2, 50.0), np.zeros(2)))
    statistics = enabled.statistics
    left_fields = {"velocity": 1, "effort": 1, "stiffness": 1, "damping": 2}
    assert statistics.saturations == {"left": left_fields, "right": {"damping": 1, "position": 1}}
    assert statistics.bounded == {"left": 2}
    at = -(enabled.read()[0].joint_position[0] + 17.0 / 50.0)
    assert wait_until(lambda: bool(left.commands) and left.commands[-1].position == pytest.approx(at, abs=4e-4))
    text = "\n".join(statistics.lines())
    counted = "velocity 1 times, effort 1 times, stiffness 1 times, damping 2 times"
    assert f"left: cut off at the motor's range: {counted}" in text
    assert "position moved to keep within the effort limit: left 2 times" in text


def test_a_silent_joint_keeps_its_values_and_ages(enabled, left):
    left.is_silent = True
    begin = time.monotonic()
    status = _wait_for(enabled, SafetyFlag.RX_TIMEOUT)
    assert 0.15 < time.monotonic() - begin < 1.0
    assert status.level is FAULT
    assert wait_until(lambda: _statuses(enabled)[0].message == f"silent: left; check its plug{THEN}")
    assert enabled.statistics.faults == {"left": ("silent",)}
    state, _ = enabled.read()
    assert state.joint_position[0] == pytest.approx(-0.25, abs=4e-4)
    assert state.joint_age[0] > 0.2 > state.joint_age[1]


def test_a_motor_that_falls_out_of_run_mode_is_a_fault_and_stays_out(enabled, left):
    left.mode = MotorMode.RESET
    status = _wait_for(enabled, SafetyFlag.MOTOR_FAULT)
    why = f"find the cause|{STOOD_STILL}"  # the machine may have done so
    assert status.level is FAULT
    assert re.fullmatch(rf"left run mode \(mode reset\): left; ({why}){re.escape(THEN)}", status.message)
    for _ in range(5):
        enabled.write(_hold(0.0))
        time.sleep(0.01)
    assert not any(isinstance(command, Enable) for command in left.heard)
    assert _statuses(enabled)[0].flags == SafetyFlag.MOTOR_FAULT


@pytest.mark.soak
def test_a_program_that_stood_still_is_the_cause_of_what_its_motors_did_meanwhile(enabled, left, right):
    """As after SIGSTOP: they stopped by their CAN timeout, and a motor that is heard again later was not unplugged."""
    _statuses(enabled)
    left.mode = MotorMode.RESET
    right.is_silent = True
    time.sleep(0.3)
    messages = [status.message for status in _statuses(enabled)]
    assert re.fullmatch(rf"left run mode \(mode reset\): left; {STOOD_STILL}{re.escape(THEN)}", messages[0])
    assert re.fullmatch(rf"silent: right; {STOOD_STILL}{re.escape(THEN)}", messages[1])
    assert wait_until(lambda: _statuses(enabled)[1].message == f"silent: right; check its plug{THEN}")
    assert _statuses(enabled)[0].message == messages[0], "that stays the cause until they are enabled again"


TOO_HOT, COOL = SafetyFlag.MOTOR_FAULT | SafetyFlag.TEMPERATURE_LIMIT, ": 25 °C (limit 135 °C); let it cool"
STALLED_AND_BLIND = StatusFault.STALL_OVERLOAD | StatusFault.ENCODER_FAULT
HOT_SOON = WarningBit.MOTOR_OVERTEMPERATURE_WARNING


@pytest.mark.parametrize(
    ("faults", "flags", "text"),
    [
        (StatusFault.UNDERVOLTAGE, SafetyFlag.MOTOR_FAULT, "undervoltage: left; find the cause"),
        (StatusFault.MOTOR_OVERTEMPERATURE, TOO_HOT, f"left is too hot{COOL}"),
        (STALLED_AND_BLIND, SafetyFlag.MOTOR_FAULT, "encoder_fault: left; stall_overload: left; find the cause"),
    ],
)
def test_a_fault_in_a_status_is_flagged_while_it_lasts(faults, flags, text, enabled, left):
    left.faults = faults
    status = _wait_for(enabled, flags)
    assert (status.level, status.message) == (FAULT, f"{text}{THEN}")
    words = tuple(part.removesuffix(": left").removeprefix("left ") for part in text.split("; ")[:-1])
    assert enabled.statistics.faults == {"left": words}
    left.faults = StatusFault(0)
    assert wait_until(lambda: _statuses(enabled)[0].is_ok)
    assert enabled.statistics.faults == {}


@pytest.mark.parametrize(
    ("faults", "warnings", "flags", "text"),
    [
        (FaultBit.OVERVOLTAGE, WarningBit(0), SafetyFlag.MOTOR_FAULT, "overvoltage: left; find the cause"),
        (FaultBit.MOTOR_OVERTEMPERATURE, WarningBit(0), TOO_HOT, f"left is too hot{COOL}"),
        (FaultBit(0), HOT_SOON, SafetyFlag.TEMPERATURE_LIMIT, f"left is nearly too hot{COOL}"),
        (FaultBit.STALL_OVERLOAD, WarningBit(0), SafetyFlag.MOTOR_FAULT, "stall_overload: left; find the cause"),
    ],
)
def test_a_fault_report_holds_until_the_motor_reports_none(faults, warnings, flags, text, enabled, motors):
    motors.send(motors.buses[0], fault_report(11, faults, warnings))
    status = _wait_for(enabled, flags)
    assert (status.level, status.message) == (FAULT, f"{text}{THEN}")
    time.sleep(0.05)
    assert _statuses(enabled)[0] == status, "frames without a fault bit do not clear it"
    motors.send(motors.buses[0], fault_report(11, FaultBit(0)))
    assert wait_until(lambda: _statuses(enabled)[0].is_ok)


def test_a_position_that_jumps_is_a_fault_until_the_next_activation(enabled, left):
    assert _statuses(enabled)[0].is_ok
    left.position += 0.8
    status = _wait_for(enabled, SafetyFlag.MOTOR_FAULT)
    assert status.message == f"position jumped: left; find the cause{THEN}"
    left.position -= 0.8
    time.sleep(0.1)
    assert not _statuses(enabled)[0].is_ok, "nobody knows which of the two was right"
    enabled.activate()
    assert _statuses(enabled)[0].is_ok


@pytest.mark.parametrize(
    ("frame", "text"),
    [
        (Frame(join_identifier(2, 0x80, 11, 0xFD), bytes(5)), "sent a status with 5 bytes, expected 8: left"),
        (Frame(join_identifier(10, 0x80, 11, 0xFD), bytes(8)), "sent a frame of communication type 10: left"),
        (
            encode_command(OperationControl(11, 0.0, 0.0, 0.0, 9.0, 0.0), MOTORS["rs-02"]),
            "another host sends 'operation control' to motor 11",
        ),
        (encode_command(Stop(11, host_id=0xFE), MOTORS["rs-02"]), "host 0xFE sends 'stop' to motor 11"),
        (Frame(join_identifier(2, 0x80, 11, 0xAA), bytes(8)), "motor 11 answers host 0xAA, not 0xFD"),
    ],
)
def test_frames_that_should_not_be_are_a_warning_for_a_while(frame, text, enabled, motors):
    motors.send_frame(motors.buses[0], frame)
    begin = time.monotonic()
    status = _wait_for(enabled, SafetyFlag.INVALID_FRAME)
    assert (status.level, status.message) == (WARNING, text)
    assert wait_until(lambda: _statuses(enabled)[0].is_ok)
    assert 0.15 < time.monotonic() - begin < 1.0
    assert np.isfinite(enabled.read()[0].joint_position).all()


def test_strangers_and_scans_stop_nothing(enabled, motors):
    before = sum(enabled.statistics.channels[0].strangers.values())
    motors.send_frame(motors.buses[0], Frame(join_identifier(2, 0xBF, 99, 0xFD), bytes(8)))
    motors.send_frame(motors.buses[0], encode_command(GetDeviceId(11, host_id=0xFE), MOTORS["rs-02"]))
    assert wait_until(lambda: sum(enabled.statistics.channels[0].strangers.values()) == before + 2)
    assert all(status.is_ok for status in _statuses(enabled))


def test_a_flood_is_called_one(enabled, motors):
    def is_seen():
        for _ in range(100):
            motors.send_frame(motors.buses[0], Frame(0x7F, bytes(8), is_extended=False))
        return not _statuses(enabled)[0].is_ok

    assert wait_until(is_seen)
    status = _statuses(enabled)[0]
    assert (status.level, status.flags) == (WARNING, SafetyFlag.NONE)
    assert status.message == ("the bus is flooded: more than 3000 frames a second that concern none of its motors")
    assert wait_until(lambda: _statuses(enabled)[0].is_ok)


_ERROR = Frame(0x08, bytes(8), is_extended=False, is_error=True)


def test_single_error_frames_are_counted_and_stop_nothing(enabled, motors):
    for _ in range(5):
        motors.send_frame(motors.buses[0], _ERROR)
    counters = enabled.statistics.channels[0].counters
    assert wait_until(lambda: counters.error_frames == 5)
    assert all(status.is_ok for status in _statuses(enabled))
    warning = f"warning: {enabled.statistics.channels[0].source}: 5 CAN error frames: protocol violation 5 times"
    assert warning in enabled.statistics.lines()


def test_a_burst_of_error_frames_is_a_warning_without_a_flag(enabled, motors):
    for _ in range(12):
        motors.send_frame(motors.buses[0], _ERROR)
    assert wait_until(lambda: not _statuses(enabled)[0].is_ok)
    status = _statuses(enabled)[0]
    assert (status.level, status.flags) == (WARNING, SafetyFlag.NONE)
    assert status.message == "more than 50 bus errors a second, mostly: protocol violation"
    assert _statuses(enabled)[1].is_ok
    assert wait_until(lambda: _statuses(enabled)[0].is_ok)


def test_bus_off_lasts_until_the_next_activation(enabled, motors):
    motors.send_frame(motors.buses[0], Frame(0x40, bytes(8), is_extended=False, is_error=True))
    status = _wait_for(enabled, SafetyFlag.BUS_OFF)
    assert (status.level, status.message) == (FAULT, f"down: bus-off; check its cable, terminators and supply{THEN}")
    time.sleep(0.1)
    assert _statuses(enabled)[0] == status, "frames that come again do not clear it"
    enabled.activate()
    assert all(status.is_ok for status in _statuses(enabled))


class _FailingBus:
    """The computer's end of a channel, whose sending fails when it is told to."""

    def __init__(self):
        self.error = None

    def __call__(self, address):
        bus = open_bus(address)
        send = bus.send

        def failing(message, timeout=None):
            if self.error is not None and address.channel.startswith("left"):
                raise self.error
            send(message, timeout)

        bus.send = failing
        return bus


@pytest.mark.parametrize(
    ("error", "flags", "level"),
    [
        (can.CanOperationError("no buffer", error_code=errno.ENOBUFS), SafetyFlag.TX_QUEUE_OVERRUN, WARNING),
        (can.CanOperationError("Transmit buffer full"), SafetyFlag.TX_QUEUE_OVERRUN, WARNING),
        (can.CanOperationError("down", error_code=errno.ENETDOWN), SafetyFlag.BUS_OFF, FAULT),
    ],
)
def test_a_channel_that_cannot_send_is_flagged_and_commands_do_not_wait(error, flags, level, make_robot, right):
    failing = _FailingBus()
    robot = make_robot(open_bus=failing)
    robot.activate()
    failing.error = error
    robot.write(_hold())
    status = _wait_for(robot, flags)
    assert status.level is level
    right.heard.clear()
    longest = 0.0
    for _ in range(5):
        begin = time.perf_counter()
        robot.write(_hold(0.0))
        longest = max(longest, time.perf_counter() - begin)
        time.sleep(0.005)
    assert longest < 0.1
    assert wait_until(lambda: bool(right.commands) and right.commands[-1].stiffness == 0.0), (
        "the other channel is served"
    )
    failing.error = None


def test_after_a_jam_the_latest_command_leaves(make_robot, left):
    failing = _FailingBus()
    robot = make_robot(open_bus=failing)
    robot.activate()
    left.heard.clear()
    failing.error = can.CanOperationError("no buffer", error_code=errno.ENOBUFS)
    for _ in range(5):
        robot.write(_hold())
        time.sleep(0.025)
    robot.write(_hold(0.0, 3.0))
    failing.error = None
    assert wait_until(lambda: bool(left.commands))
    time.sleep(0.02)
    assert [command.stiffness for command in left.commands] == [0.0]
    assert robot.statistics.channels[0].counters.overruns > 0


def test_random_frames_raise_nothing_and_leave_no_joint_unheard_of(enabled, motors, left, right):
    """Frames of other motors, other hosts, wrong lengths and types: positions stay those that the motors told."""
    generator = random.Random(7)
    positions = enabled.read()[0].joint_position
    sent = 0
    while sent < 3000:
        frame = random_frame(generator)
        if frame.arbitration_id >> 8 & 0xFF in {11, 21} and frame.arbitration_id >> 24 in {2, 24}:
            continue  # what a motor itself would say
        motors.send_frame(motors.buses[sent % 2], frame)
        sent += 1
        if sent % 50 == 0:
            state, statuses = enabled.read()
            enabled.write(_hold())
            np.testing.assert_allclose(state.joint_position, positions, atol=1e-9)
            assert len(statuses) == 2
    assert sum(channel.counters.receiver_failures for channel in enabled.statistics.channels) == 0


def _random_message(generator):
    """Anything that a driver may hand over: data, error, remote and CAN FD frames."""
    frame = random_frame(generator)
    kind = generator.random()
    return can.Message(
        arbitration_id=frame.arbitration_id,
        data=generator.randbytes(generator.choice((12, 64))) if kind > 0.98 else frame.data,
        is_extended_id=frame.is_extended,
        is_remote_frame=frame.is_remote,
        is_error_frame=kind < 0.05,
        is_fd=kind > 0.98,
        check=False,
    )


@pytest.mark.soak
def test_random_messages_for_minutes_neither_raise_nor_stop_the_threads(enabled, motors, fuzzing_seconds):
    seed = random.SystemRandom().getrandbits(32)
    print(f"seed {seed}")
    generator = random.Random(seed)
    sent, deadline = 0, time.monotonic() + fuzzing_seconds
    while time.monotonic() < deadline:
        for _ in range(50):
            motors.buses[sent % 2].send(_random_message(generator))
            sent += 1
        state, statuses = enabled.read()
        enabled.write(_hold())
        assert state.joint_count == 2
        assert len(statuses) == 2
        assert np.isfinite(state.joint_velocity).all()
        time.sleep(0.002)
    channels = enabled.statistics.channels
    assert all(channel.counters.receiver_failures == 0 for channel in channels)
    assert wait_until(lambda: sum(channel.counters.received for channel in channels) > 0.8 * sent, 30.0)
    assert not any("has ended" in status.message for status in enabled.read()[1])


def test_messages_do_not_change_from_tick_to_tick(enabled, left):
    left.is_silent = True
    left.mode = MotorMode.RESET
    _wait_for(enabled, SafetyFlag.RX_TIMEOUT)
    time.sleep(0.1)
    seen = set()
    for _ in range(10):
        seen.add(_statuses(enabled))
        time.sleep(0.005)
    assert len(seen) == 1
