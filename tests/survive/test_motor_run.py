"""Motors under control: what goes wrong on the wire becomes a status, and what leaves is one sound command."""

import errno
import math
import time

import numpy as np
import pytest
from motor_surface import bring_up_lines, mit_command
from wire_motor import GET_ID, RESET, STATUS, STOP, Operation, fault_frame, identifier, operation_frame
from wire_rig import LEFT_AT, PERIOD, RIGHT_AT, Pair, Run, hold, until, write_calibration

from humanoid_sim.errors import RobotError
from humanoid_sim.messages import Mode, SafetyFlag, SafetyLevel

BUS_OFF, RX_TIMEOUT, TX_OVERRUN = SafetyFlag.BUS_OFF, SafetyFlag.RX_TIMEOUT, SafetyFlag.TX_QUEUE_OVERRUN
MOTOR_FAULT, TEMPERATURE, INVALID = SafetyFlag.MOTOR_FAULT, SafetyFlag.TEMPERATURE_LIMIT, SafetyFlag.INVALID_FRAME


@pytest.fixture
def pair(tmp_path, monkeypatch):
    with Pair(tmp_path, monkeypatch) as pair:
        yield pair


@pytest.fixture
def robot(pair):
    return pair.active()


def status_with(pair, robot, flag, channel=0):
    """Let the robot's clock go on until a channel's status has this flag; the other channel stays OK."""

    def found():
        state, statuses = robot.read()
        pair.now += 0.2 * PERIOD if state.joint_age[1 - channel] < 0.1 else 0.0
        return flag in statuses[channel].flags and statuses

    statuses = until(found, f"no {flag!r}")
    assert pair.channels[channel].removeprefix("virtual:") in statuses[channel].source
    assert statuses[1 - channel].is_ok
    return statuses[channel]


# --- faults


def _set(**fields):
    def happen(pair):
        for name, value in fields.items():
            setattr(pair.left, name, value)

    return happen


def _report(faults, warnings=0):
    return lambda pair: pair.buses[0].send(*fault_frame(11, faults, warnings))


def _slip(pair):
    pair.left.position += 0.8


FAULTS = {
    "undervoltage": (_set(faults=1 << 0), MOTOR_FAULT),
    "phase current": (_set(faults=1 << 1), MOTOR_FAULT),
    "too hot": (_set(faults=1 << 2), TEMPERATURE),
    "encoder": (_set(faults=1 << 3), MOTOR_FAULT),
    "stall": (_set(faults=1 << 4), MOTOR_FAULT),
    "uncalibrated": (_set(faults=1 << 5), MOTOR_FAULT),
    "overvoltage, reported": (_report(1 << 3), MOTOR_FAULT),
    "too hot, reported": (_report(1 << 0), TEMPERATURE),
    "warm, reported": (_report(0, 1 << 0), TEMPERATURE),
    "stopped by itself": (_set(mode=RESET), MOTOR_FAULT),
    "silent": (_set(is_silent=True), RX_TIMEOUT),
    "encoder slipped": (_slip, MOTOR_FAULT),
}


@pytest.mark.parametrize("name", FAULTS)
def test_the_tick_that_reads_a_motors_fault_commands_damping(name, pair, robot):
    happen, flag = FAULTS[name]
    run = Run(pair, robot)
    run.stand()
    happen(pair)
    for _ in range(20):
        output, (left, right) = run.tick()
        if not left.is_ok:
            break
    assert left.level is SafetyLevel.FAULT
    assert flag in left.flags
    assert "left" in left.message
    assert right.is_ok
    assert output.control_mode.mode is Mode.DAMPING
    assert not output.command.stiffness.any()
    for motor in pair.motors:
        last = pair.commands(motor)[-1]
        assert (last.velocity, last.effort, last.kp) == (0.0, 0.0, 0.0)
        assert last.kd == pytest.approx(3.0, abs=1e-3)
    if name == "silent":
        state, _ = robot.read()
        assert state.joint_position[0] == pytest.approx(LEFT_AT, abs=1e-3), "the last one that was heard"
        assert state.joint_age[0] > 0.2 > state.joint_age[1]


def test_a_status_fault_is_reported_while_it_lasts(pair, robot):
    pair.left.faults = 1
    status_with(pair, robot, MOTOR_FAULT)
    pair.left.faults = 0
    pair.now += 1.0
    until(lambda: all(status.is_ok for status in pair.answered(robot)[1]))


def test_a_slipped_encoder_stays_a_fault_until_the_next_activation_which_mentions_it(pair, robot):
    """Nobody knows which of the two positions was right."""
    pair.answered(robot)
    _slip(pair)
    status_with(pair, robot, MOTOR_FAULT)
    pair.left.position -= 0.8
    pair.now += 1.0
    assert MOTOR_FAULT in pair.answered(robot)[1][0].flags
    robot.activate()
    assert all(status.is_ok for status in pair.answered(robot)[1])
    assert [line for line in bring_up_lines(robot) if "left" in line and "jump" in line]


def test_an_angle_that_wraps_at_the_end_of_the_motors_range_is_followed(pair):
    """Reports run cyclically from -4π to 4π, and commands end there: no jump, and a fault."""
    calibration = write_calibration(pair.folder / "far.yaml", left=11.0)
    pair.left.position = 12.5
    robot = pair.active(calibration=calibration)
    pair.left.velocity = 1.5
    while pair.left.position < 12.65:
        state, _ = pair.answered(robot)
        assert state.joint_position[0] == pytest.approx(11.0 - pair.left.position, abs=2e-3)
        pair.left.position += 1.5 * PERIOD
        pair.now += PERIOD
    pair.left.velocity = 0.0
    assert status_with(pair, robot, MOTOR_FAULT).level is SafetyLevel.FAULT


def _error_frame(pair, robot):
    pair.buses[0].send(0x40, bytes(8), is_error=True)
    status_with(pair, robot, BUS_OFF)


def _network_down(pair, robot):
    with pair.jammed(errno.ENETDOWN):
        robot.write(hold())
        status_with(pair, robot, BUS_OFF)


@pytest.mark.parametrize("happen", [_error_frame, _network_down])
def test_bus_off_lasts_until_the_robot_is_activated_again(happen, pair, robot):
    happen(pair, robot)
    for _ in range(3):
        pair.now += 1.0
        pair.buses[0].send(*pair.left.status())  # a frame that comes again does not clear it
        status = robot.read()[1][0]
        assert (status.level, BUS_OFF in status.flags) == (SafetyLevel.FAULT, True)
    robot.activate()
    assert all(status.is_ok for status in pair.answered(robot)[1])


@pytest.mark.parametrize(
    "frame",
    [
        (identifier(STATUS, 0x8000 | 11, 0xFD), bytes(5)),
        (identifier(10, 0x8000 | 11, 0xFD), bytes(8)),
        operation_frame(11, "rs-02", Operation(0.0, 0.0, 0.0, 9.0, 0.0)),
        (identifier(STOP, 0xFE, 11), bytes(8)),
    ],
    ids=["short status", "unknown type", "another master commands", "another master stops"],
)
def test_a_frame_that_should_not_be_is_a_warning_for_a_while(frame, pair, robot):
    pair.buses[0].send(*frame)
    assert status_with(pair, robot, INVALID).level is SafetyLevel.WARNING
    pair.now += 1.0
    assert all(status.is_ok for status in pair.answered(robot)[1])
    assert np.isfinite(robot.read()[0].joint_position).all()


def test_strangers_and_scans_stop_nothing(pair, robot):
    pair.buses[0].send(identifier(STATUS, 0xBF00 | 99, 0xFD), bytes(8))
    pair.buses[0].send(identifier(GET_ID, 0xFE, 11), bytes(8))
    pair.buses[0].send(identifier(STATUS, 0x8000 | 11, 0xFD), bytes(5))  # comes last, and is noticed
    status = status_with(pair, robot, INVALID)
    assert status.flags == INVALID
    assert "5 bytes" in status.message


# --- commands


@pytest.mark.parametrize(
    ("position", "effort"), [(1.0, 0.0), (-1.4, 0.0), (1.0, 9.0), (-1.4, -30.0), (LEFT_AT, 30.0), (1e9, 0.0)]
)
def test_a_command_asks_for_no_more_than_the_effort_limit(position, effort, pair, robot):
    """No manual says that a motor's own limit covers the sum of the MIT law."""
    pair.answered(robot)
    command = mit_command([position, RIGHT_AT], 50.0, 2.0)
    command = type(command)(command.position, command.velocity, np.full(2, effort), command.stiffness, command.damping)
    pair.command(robot, command)
    sent = pair.commands(pair.left)[-1]
    torque = sent.kp * (sent.position - pair.left.position) + sent.effort
    asked = 50.0 * (position - LEFT_AT) + effort
    assert torque == pytest.approx(-math.copysign(min(abs(asked), 12.0), asked), abs=0.05), "-1 is its direction"


def test_a_command_that_is_not_finite_becomes_damping_for_all(pair, robot):
    pair.command(robot, mit_command([math.nan, RIGHT_AT], 50.0, 2.0))
    for motor in pair.motors:
        command = pair.commands(motor)[-1]
        assert (command.effort, command.kp) == (0.0, 0.0)
        assert command.kd == pytest.approx(3.0, abs=1e-3)
    assert max(status.level for status in robot.read()[1]) is SafetyLevel.CRITICAL
    with pytest.raises(RobotError, match=r"\(3,\)"):
        robot.write(mit_command([0.0] * 3, 50.0, 2.0))


def _stiffness(pair, motor):
    return [round(command.kp) for command in pair.commands(motor)]


def test_after_a_jam_the_newest_command_leaves_and_no_older_one(pair, robot):
    with pair.jammed():
        for stiffness in (50.0, 40.0, 30.0, 20.0):
            robot.write(hold(stiffness=stiffness))
            pair.now += PERIOD
        until(lambda: 20 in _stiffness(pair, pair.right), "the other bus is served")
        robot.write(hold(stiffness=0.0, damping=3.0))
        status = status_with(pair, robot, TX_OVERRUN)
        assert status.level is SafetyLevel.WARNING
        robot.write(hold(stiffness=0.0, damping=3.0))
    until(lambda: pair.commands(pair.left))
    robot.write(hold(stiffness=10.0))
    until(lambda: _stiffness(pair, pair.left)[-1] == 10)
    assert _stiffness(pair, pair.left) == [0, 10]


def test_a_command_that_could_not_leave_in_time_never_does(pair, robot):
    """By then there are newer ones, or none because the program stood still: the robot is elsewhere."""
    with pair.jammed():
        robot.write(hold())
        pair.now += 5.0 * PERIOD
    time.sleep(0.05)  # the bus is free, and the sender tries again every few ms
    robot.write(hold(stiffness=0.0, damping=3.0))
    until(lambda: pair.commands(pair.left))
    assert _stiffness(pair, pair.left) == [0]


def test_on_a_bus_that_takes_half_of_the_frames_every_motor_is_served(tmp_path, monkeypatch):
    with Pair(tmp_path, monkeypatch, one_channel=True) as pair:
        robot = pair.active()
        served = {motor.motor_id: 0 for motor in pair.motors}
        with pair.jammed() as permits:
            for _ in range(60):
                robot.write(hold())
                permits[0] = 1
                until(lambda: permits[0] == 0)
        until(lambda: len(pair.log) >= 60)
        for motor in pair.motors:
            served[motor.motor_id] = len(pair.commands(motor))
        assert min(served.values()) >= 10, served


def test_nothing_is_sent_to_motors_that_are_not_enabled(pair):
    robot = pair.robot()
    pair.left.faults, pair.left.refuses = 1, {STOP}
    pair.waits(answers=0.03)
    with pytest.raises(RobotError):
        robot.activate()
    pair.log.clear()
    robot.write(hold())
    state, statuses = robot.read()
    assert {status.level for status in statuses} == {SafetyLevel.FAULT}
    assert state.joint_count == 2
    pair.left.obey()
    robot.close()
    assert not [frame for frame in pair.log if frame.operation is not None]
