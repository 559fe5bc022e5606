import contextlib
import errno
import math
import threading
import time

import can
import msgspec
import numpy as np
import pytest
from scripted_motors import ScriptedMotor, ScriptedMotors
from waiting import wait_until

from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.hardware.adapter import control
from humanoid_sim.hardware.adapter.robot import HardwareRobot
from humanoid_sim.hardware.bus.address import BusAddress, open_bus
from humanoid_sim.hardware.checks import Verdict
from humanoid_sim.hardware.imu.interface import upright_at_rest
from humanoid_sim.hardware.robstride.codec import encode_command
from humanoid_sim.hardware.robstride.messages import (
    Enable,
    GetDeviceId,
    MotorMode,
    OperationControl,
    ReadParameter,
    ReadVersion,
    SetActiveReport,
    StatusFault,
    Stop,
    WriteParameter,
)
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, unpack_value
from humanoid_sim.hardware.robstride.requests import _ANSWER_TIMES
from humanoid_sim.messages import OK, SafetyFlag, SafetyLevel
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.motors import MOTORS
from humanoid_sim.robots.schema import RemoteSettings


def _refusal(robot):
    """The problems of an activation that must be refused; no motor may have been enabled."""
    with pytest.raises(RobotError) as caught:
        robot.activate()
    head, *problems = str(caught.value).split("\n  - ")
    assert head == f"pair: not enabled, {len(problems)} problem{'s' if len(problems) > 1 else ''}:"
    assert not robot.is_enabled
    return problems


def _warnings(robot):
    return [str(check) for check in robot.checks if check.verdict is Verdict.WARNING]


def _parameter(motor, name):
    parameter = PARAMETERS[name]
    return unpack_value(parameter.type, motor.parameters[parameter.index])


def _wrote(motor):
    """Whether the motor was told anything but to identify itself."""
    return any(not isinstance(command, GetDeviceId | ReadVersion) for command in motor.heard)


# --- what is right


def test_sound_motors_are_configured_and_enabled_without_torque(robot, left, right):
    robot.activate()
    assert robot.is_enabled
    assert [left.mode, right.mode] == [MotorMode.RUN, MotorMode.RUN]
    assert _parameter(left, "run_mode") == 0
    assert [_parameter(left, "canTimeout"), _parameter(right, "canTimeout")] == [2000, 2000]
    assert [_parameter(left, "limit_torque"), _parameter(right, "limit_torque")] == [17.0, 10.0]
    assert _parameter(left, "limit_cur") == 23.0
    assert not any(isinstance(c, WriteParameter) and c.index == 0x7018 for c in right.heard), "0 leaves the firmware's"
    for motor in (left, right):
        kinds = [type(command) for command in motor.heard if not isinstance(command, ReadParameter | WriteParameter)]
        assert kinds.index(OperationControl) < kinds.index(Enable) < len(kinds) - 1
        assert kinds[-1] is OperationControl
        for command in motor.commands:
            assert (command.effort, command.stiffness, command.damping) == (0.0, 0.0, 0.0)
            assert command.position == pytest.approx(motor.position, abs=4e-4)
    state, statuses = robot.read()
    assert state.joint_position.tolist() == pytest.approx([-0.25, 0.5], abs=4e-4)
    channels = [str(address) for address in robot._settings.addresses]
    assert [status.source for status in statuses] == [f"humanoid_devices_robstride/{name}" for name in channels]
    assert all(status.is_ok for status in statuses)
    lines = {check.subject: str(check) for check in robot.checks}
    assert "motor 11 on virtual:left-" in lines["left"]
    for part in (
        "rs-02, firmware 0.2.3.9, uid 0102030405060708",
        "run_mode 0",
        "stops 100 ms after the last command",
        "torque limit 17 N·m; current limit 23 A",
        "at -0.250 rad = -14.3°",
    ):
        assert part in lines["left"]
    assert all(check.verdict is not Verdict.PROBLEM for check in robot.checks)
    assert not _warnings(robot)
    assert any("supply 48.0 V at" in line for line in lines.values())


def test_no_limit_is_written_beyond_the_peak_of_the_motors_data_sheet(make_robot, description, left, right):
    joints = []
    for joint, torque, current in zip(description.joints, (170.0, 14.0), (27.0, 16.0), strict=True):
        assert joint.motor is not None
        motor = msgspec.structs.replace(joint.motor, torque_limit=torque, current_limit=current)
        joints.append(msgspec.structs.replace(joint, motor=motor))
    robot = make_robot(pair=msgspec.structs.replace(description, joints=tuple(joints)))
    robot.prepare()
    assert [_parameter(left, "limit_torque"), _parameter(left, "limit_cur")] == [17.0, 23.0]
    assert [_parameter(right, "limit_torque"), _parameter(right, "limit_cur")] == [14.0, 15.5]
    lines = {check.subject: str(check) for check in robot.checks}
    limits = (
        "torque limit 17 N·m (data sheet; robot file says 170); current limit 23 A (data sheet; robot file says 27)"
    )
    assert limits in lines["left"]
    assert "torque limit 14 N·m; current limit 15.5 A (data sheet; robot file says 16)" in lines["right"]
    assert not _warnings(robot)


def test_preparing_does_everything_but_enabling(robot, left):
    robot.prepare()
    assert not robot.is_enabled
    assert left.mode is MotorMode.RESET
    assert _parameter(left, "canTimeout") == 2000
    assert not any(isinstance(command, Enable) for command in left.heard)
    assert all((c.stiffness, c.damping, c.effort, c.velocity) == (0.0, 0.0, 0.0, 0.0) for c in left.commands)
    state, statuses = robot.read()
    assert state.joint_position[0] == pytest.approx(-0.25, abs=4e-4)
    assert [(status.level, status.flags) for status in statuses] == [(SafetyLevel.FAULT, SafetyFlag.MOTOR_FAULT)] * 2


def test_a_dry_run_never_enables(make_robot, left):
    robot = make_robot(dry_run=True)
    with pytest.raises(RobotError, match="this is a dry run"):
        robot.activate()
    assert _parameter(left, "canTimeout") == 2000
    assert left.reports
    robot.close()
    assert not any(isinstance(command, Enable) for command in left.heard)
    assert wait_until(lambda: not left.reports), "and leaves nobody talking"


def test_lost_frames_are_asked_for_again(robot, left):
    seen = {}

    def every_second(command):
        seen[type(command)] = seen.get(type(command), 0) + 1
        return isinstance(command, WriteParameter) or seen[type(command)] % 2 == 0

    left.hears = every_second
    robot.activate()
    assert robot.is_enabled
    assert seen[Enable] >= 2


def test_reports_are_left_off_where_answers_come_as_often(make_robot, left):
    robot = make_robot(control_period=0.005)
    robot.prepare()
    assert not left.reports
    assert any("no active reports: commands are answered as often" in str(check) for check in robot.checks)


@pytest.mark.usefixtures("impatient")
def test_a_motor_that_does_not_report_is_mentioned(robot, left):
    left.hears = lambda command: not isinstance(command, SetActiveReport)
    robot.activate()
    assert _warnings(robot) == ["warning: left: sends no active reports: its state is a control period old"]


# --- who is there


@pytest.mark.usefixtures("impatient")
def test_a_missing_motor_keeps_every_motor_from_being_touched(robot, left, right, channels):
    right.is_silent = True
    assert _refusal(robot) == [f"right: motor 21 does not answer on {channels[1]}"]
    assert not any(isinstance(command, WriteParameter | Enable) for command in left.heard)


@pytest.mark.usefixtures("impatient")
def test_a_dead_channel_is_one_problem(description, channels):
    robot = HardwareRobot(description, channels[:1], calibration={"left": 0.0, "right": 0.0})
    ended = threading.Event()

    def complain():
        with can.Bus(interface="virtual", channel=channels[0].channel) as bus:
            while not ended.wait(0.005):
                bus.send(can.Message(arbitration_id=0x20, data=bytes(8), is_error_frame=True))

    thread = threading.Thread(target=complain)
    thread.start()
    (problem,) = _refusal(robot)
    ended.set()
    thread.join()
    robot.close()
    assert problem == (
        f"{channels[0]}: no motor answers: are they powered, is the bus terminated, is it set to 1 Mbit/s? "
        "What was noticed: no acknowledgement on transmission"
    )


@pytest.mark.usefixtures("attentive", "impatient")
def test_a_channel_of_other_motors_is_not_dead(description, channels):
    with ScriptedMotors([(channels[0], [ScriptedMotor(99)])]):
        robot = HardwareRobot(description, channels[:1], calibration={"left": 0.0, "right": 0.0})
        problems = _refusal(robot)
        robot.close()
    assert problems == [
        f"left: motor 11 does not answer on {channels[0]}",
        f"right: motor 21 does not answer on {channels[0]}",
    ]


@pytest.mark.usefixtures("attentive", "impatient")
def test_swapped_channels_are_recognised(channels, description, left, right):
    with ScriptedMotors([(channels[0], [right]), (channels[1], [left])]):
        robot = HardwareRobot(description, channels, calibration={"left": 0.0, "right": 0.0})
        problems = _refusal(robot)
        robot.close()
    assert problems == [
        f"left: motor 11 does not answer on {channels[0]}; {channels[1]} has a motor 11: are the channels swapped?",
        f"right: motor 21 does not answer on {channels[1]}; {channels[0]} has a motor 21: are the channels swapped?",
    ]


@pytest.mark.usefixtures("attentive", "impatient")
@pytest.mark.parametrize("where", [0, 1])
def test_a_second_motor_with_an_expected_id_is_refused(where, robot, channels, left):
    twin = ScriptedMotor(11, uid=b"the twin")
    with ScriptedMotors([(channels[where], [twin])]):
        (problem,) = _refusal(robot)
    if where == 0:
        assert problem.startswith(f"left: 2 motors answer as 11 on {channels[0]} (uid 0102030405060708 and 746865")
    else:
        assert problem == f"left: a second motor 11 answers on {channels[1]}"
    assert not _wrote(left) or {type(c) for c in left.heard} <= {GetDeviceId, ReadVersion, Stop}


@pytest.mark.usefixtures("attentive")
def test_a_motor_that_is_no_joint_is_left_alone(robot, channels):
    stranger = ScriptedMotor(0x7F, uid=b"new one!")
    with ScriptedMotors([(channels[0], [stranger])]):
        robot.activate()
    assert _warnings(robot) == [f"warning: {channels[0]}: motor 127 is not a joint of this robot; it is left alone"]
    assert not _wrote(stranger)


def test_firmware_that_no_document_mentions_is_a_question_to_the_operator(robot, left):
    left.version = (0, 2, 3, 10)
    robot.prepare()
    (question,) = (check for check in robot.checks if check.verdict is Verdict.QUESTION)
    assert (question.subject, question.about) == ("left", "0.2.3.10")
    assert question.text.startswith("its firmware 0.2.3.10 is newer than the newest that is documented, 0.2.3.9: ")
    with pytest.raises(
        RobotError, match=r"^pair: not enabled: left: its firmware .* add --accept-firmware 0\.2\.3\.10$"
    ):
        robot.activate()
    assert left.mode is MotorMode.RESET
    assert not any(isinstance(command, Enable) for command in left.heard)
    robot.accept(["0.2.3.10"])
    robot.activate()
    assert robot.is_enabled
    assert any("left: its firmware 0.2.3.10 is newer" in line for line in _warnings(robot))


def test_a_motor_that_answers_operation_control_to_a_stored_host_is_not_enabled(robot, left, right):
    left.stored_host, right.stored_host = 0xAA, 0x00
    what = "which is stored in the motor, and not to 253, this host"
    stored = "store 253 in it (CAN_MASTER, with the vendor's program)"
    assert _refusal(robot) == [
        f"left: answers operation control to host 170, {what}: start with --host-id 170, or {stored}",
        f"right: answers operation control to host 0, {what}: {stored}",
    ]
    assert not any(isinstance(command, Enable) for motor in (left, right) for command in motor.heard)


def test_a_stored_host_is_found_out_at_the_latest_when_the_motor_is_enabled(robot, left):
    left.stored_host, left.answers_stopped = 0xAA, False
    (problem,) = _refusal(robot)
    assert problem.startswith("left: answers operation control to host 170, which is stored in the motor")
    assert left.mode is MotorMode.RESET
    assert all((c.stiffness, c.damping, c.effort) == (0.0, 0.0, 0.0) for c in left.commands)


def test_the_stored_host_may_be_ours(make_robot, left, right):
    left.stored_host = right.stored_host = 0xAA
    robot = make_robot(host_id=0xAA)
    robot.activate()
    assert all(status.is_ok for status in robot.read()[1])


def test_another_master_is_left_alone(robot, motors, left, right, monkeypatch):
    monkeypatch.setattr("humanoid_sim.hardware.robstride.enabling._LISTENING", 0.05)
    frame = encode_command(OperationControl(11, 0.0, 0.0, 0.0, 10.0, 1.0), MOTORS["rs-02"])
    done = threading.Event()

    def drive():
        while not done.wait(0.005):
            ScriptedMotors.send_frame(motors.buses[0], frame)

    master = threading.Thread(target=drive)
    master.start()
    try:
        (problem,) = _refusal(robot)
    finally:
        done.set()
        master.join()
    assert problem.endswith("another master drives these motors: another host sends 'operation control' to motor 11")
    assert left.heard == []
    assert right.heard == [], "its arms would fall"


# --- are they sound, and what are they told


_OVERVOLTAGE = {0x3022: (1 << 3).to_bytes(4, "little")}
"""The fault word of a fault that no status shows."""


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize(
    ("state", "problem"),
    [
        ({"version": (0, 0, 3, 9)}, "its firmware 0.0.3.9 is an rs-00's, the robot description has an rs-02 here"),
        ({"version": (0, 2, 3, 5)}, "its firmware 0.2.3.5 multiplies K_p and K_d by 1.4167: update it"),
        ({"has_version": False}, "does not tell its firmware's version, by which its model and its scales are known"),
        (
            {"unreadable": {"canTimeout"}},
            "does not tell its CAN timeout, and was not seen to stop 150 ms after the last command: it would execute "
            "that for ever if this program died",
        ),
        ({"unreadable": {"run_mode"}}, "run_mode cannot be verified (refused)"),
        ({"unreadable": {"limit_torque"}}, "limit_torque cannot be verified (refused)"),
        ({"unwritable": {"canTimeout"}}, "canTimeout reads 0 after 2000 was written"),
        ({"faults": StatusFault.UNDERVOLTAGE, "clears_faults": False}, "faults do not clear: undervoltage"),
        ({"parameters": _OVERVOLTAGE, "clears_faults": False}, "faults do not clear: overvoltage"),
        (
            {"position": -2.5},
            "is at 2.50 rad, outside its range of -1.5 to 1 rad on any turn: calibrate it, or check its direction",
        ),
        (
            {"counted": 0.25 + 8.0 * math.pi},
            "counts 25.38 rad by itself and reports 0.25: it turned beyond ±4π since power-on; switch it off and on",
        ),
    ],
)
def test_a_motor_that_is_not_sound_is_refused(state, problem, robot, left):
    _set(left, state)
    assert _refusal(robot) == [f"left: {problem}"]
    assert left.mode is MotorMode.RESET


def test_a_silent_motor_is_waited_for_less_than_a_second():
    assert sum(_ANSWER_TIMES) < 1.0


def test_a_motor_that_stands_on_another_turn_and_counts_it_is_sound(robot, left):
    _set(left, {"position": 0.25 + 2.0 * math.pi, "counted": 0.25 + 2.0 * math.pi})
    robot.activate()
    assert left.mode is MotorMode.RUN


def _set(motor, state):
    for name, value in state.items():
        setattr(motor, name, motor.parameters | value if name == "parameters" else value)


@pytest.mark.parametrize(
    ("state", "warnings"),
    [
        (
            {"limits": {"limit_torque": 12.0}, "unreadable": {"limit_cur"}},
            ["limit_torque reads 12 N·m: the motor allows no 17", "limit_cur cannot be verified (refused)"],
        ),
        ({"parameters": _OVERVOLTAGE}, ["had faults, cleared: overvoltage"]),
        ({"unreadable": {"fault_word"}}, ["its fault word cannot be read: overvoltage would not be seen here"]),
    ],
)
def test_what_is_no_obstacle_is_mentioned(state, warnings, robot, left):
    _set(left, state)
    robot.activate()
    assert _warnings(robot) == [f"warning: left: {warning}" for warning in warnings]


def test_firmware_with_the_old_position_range_is_mentioned(robot, right):
    right.version = (0, 0, 2, 6)
    robot.activate()
    assert any("counts ±12.5 rad where frames are read as ±12.566" in line for line in _warnings(robot))


def test_more_torque_than_was_allowed_is_refused(robot, right):
    right.unwritable.add("limit_torque")
    assert _refusal(robot) == ["right: limit_torque reads 14 N·m after 10 was written"]


def test_the_fault_of_a_motor_is_cleared_and_told(robot, left):
    left.faults = StatusFault.STALL_OVERLOAD
    robot.activate()
    assert _warnings(robot) == ["warning: left: had faults, cleared: stall_overload"]
    assert Stop(11, True) in left.heard
    assert robot.read()[1][0].is_ok


def test_reports_of_an_earlier_session_do_not_hide_that_a_fault_was_cleared(robot, left):
    left.reports = True
    left.faults = StatusFault.STALL_OVERLOAD
    for _ in range(3):
        robot.prepare()
    assert not left.faults


@pytest.mark.usefixtures("impatient")
def test_a_motor_that_does_not_stop_is_refused(robot, left):
    left.mode, left.stops = MotorMode.RUN, False
    assert "left: does not confirm that it is stopped (mode run)" in _refusal(robot)
    left.stops = True


@pytest.mark.usefixtures("impatient")
def test_a_motor_that_does_not_enable_takes_the_others_down_again(robot, left, right):
    left.enables = False
    assert _refusal(robot) == ["left: was not enabled (mode reset)"]
    assert right.mode is MotorMode.RESET
    assert any(isinstance(command, Enable) for command in right.heard)


def test_motors_that_run_already_are_kept_running_while_others_are_asked(robot, left, right):
    asked = []

    def late(command):
        if isinstance(command, Enable):
            asked.append(command)
        return not isinstance(command, Enable) or len(asked) > 8

    left.hears = late
    robot.activate()
    assert sum(isinstance(command, Enable) for command in right.heard) <= 2, "it runs"
    assert len(right.commands) > 8, "and must not fall silent for a CAN timeout"


@pytest.mark.usefixtures("impatient")
def test_a_motor_that_reports_a_fault_as_it_is_enabled_is_refused(robot, left, right):
    def fails(command):
        left.faults = StatusFault.PHASE_OVERCURRENT if isinstance(command, Enable) else left.faults
        return True

    left.hears = fails
    assert _refusal(robot) == ["left: was not enabled (mode run, phase_overcurrent)"]
    assert [left.mode, right.mode] == [MotorMode.RESET, MotorMode.RESET]


# --- where are they


def test_a_turn_at_power_on_is_counted(robot, right):
    right.position = 2.0 * math.pi - 0.1
    robot.activate()
    assert robot.read()[0].joint_position[1] == pytest.approx(-0.1, abs=4e-4)
    assert any("at -0.100 rad = -5.7° (-1 turn)" in str(check) for check in robot.checks)
    assert right.commands[-1].position == pytest.approx(2.0 * math.pi - 0.1, abs=4e-4), "in the motor's own count"


def test_an_arm_that_still_swings_is_no_reason_to_refuse(robot, left):
    left.counted = left.position + 1.2  # between the status and the parameter's answer
    robot.activate()


# --- again, and together


def test_activating_again_begins_afresh(robot, left):
    robot.activate()
    left.mode = MotorMode.RESET
    left.faults = StatusFault.ENCODER_FAULT
    left.position = 0.5
    assert wait_until(lambda: not robot.read()[1][0].is_ok)
    robot.activate()
    state, statuses = robot.read()
    assert all(status.is_ok for status in statuses)
    assert left.mode is MotorMode.RUN
    assert state.joint_position[0] == pytest.approx(-0.5, abs=4e-4)


def test_a_motor_exchanged_between_two_activations_is_refused(robot, left):
    robot.activate()
    left.uid = b"another!"
    (problem,) = _refusal(robot)
    assert problem.startswith("left: its motor was exchanged (id 11 on virtual:left-")


@pytest.mark.usefixtures("impatient")
def test_a_refused_reactivation_leaves_a_robot_that_can_be_read(robot, left, right):
    robot.activate()
    left.is_silent = True
    problems = _refusal(robot)
    assert problems[0].startswith("left: motor 11 does not answer on")
    assert problems[1:] == ["left: does not confirm that it is disabled"]
    state, statuses = robot.read()
    assert [status.level for status in statuses] == [SafetyLevel.FAULT] * 2
    messages = {status.message for status in statuses}
    assert len(messages) == 1
    (message,) = messages
    assert message.startswith("no motor is driven: not enabled, 2 problems: left: motor 11 does not answer on")
    end = "; left: does not confirm that it is disabled; fix that, then press e (or: mode reactivate)"
    assert message.endswith(end)
    assert state.joint_count == 2
    assert right.mode is MotorMode.RESET


@pytest.mark.usefixtures("impatient")
def test_after_a_refused_reactivation_the_motors_are_called_off_only_if_all_confirm_it(robot, left):
    robot.activate()
    left.faults, left.clears_faults = StatusFault.ENCODER_FAULT, False
    assert _refusal(robot) == ["left: faults do not clear: encoder_fault"]
    (message,) = {status.message for status in robot.read()[1]}
    assert message == (
        "the motors are off: not enabled, 1 problem: left: faults do not clear: encoder_fault; "
        "fix that, then press e (or: mode reactivate)"
    )


def test_a_motor_that_lost_its_power_while_the_operator_was_asked_is_set_up_afresh(robot, left):
    """It comes back as from the factory: no CAN timeout, other limits, no reports."""
    robot.prepare()
    before = dict(left.parameters)
    assert left.reports
    left.reports, left.mode = False, MotorMode.RESET
    ScriptedMotor.__post_init__(left)
    assert left.parameters != before
    robot.activate()
    assert left.parameters == before
    assert left.reports
    assert left.mode is MotorMode.RUN


def test_figures_and_the_warmest_motor_are_those_of_the_whole_session(robot, left):
    robot.activate()
    robot.write(MITCommand.zeros(2))
    left.temperature = 150.0
    assert wait_until(lambda: robot.read() is not None and robot.statistics.warmest["left"] == 150.0)
    assert wait_until(lambda: robot.statistics.acknowledged == 2)
    first = robot.statistics
    left.temperature = 26.0
    robot.activate()
    robot.write(MITCommand.zeros(2))
    assert wait_until(lambda: robot.statistics.acknowledged == 4)
    robot.read()
    latest = robot.statistics
    assert latest.commanded == 4
    assert (latest.temperature["left"], latest.warmest["left"]) == (26.0, 150.0)
    assert "warmest motor: left, 150.0 °C" in latest.lines()
    assert [channel.source for channel in latest.channels] == [channel.source for channel in first.channels]
    for before, now in zip(first.channels, latest.channels, strict=True):
        assert now.counters.sent > before.counters.sent
        assert now.elapsed > before.elapsed


def test_a_second_session_is_refused_until_the_first_is_closed(make_robot):
    first, second = make_robot(), make_robot()
    first.prepare()
    problems = _refusal(second)
    assert len(problems) == 2
    assert all("is in use by another session (of this process)" in problem for problem in problems)
    first.close()
    second.prepare()


def test_channels_that_cannot_be_opened_are_listed(make_robot):
    def refuse(address):
        raise RobotError(f"{address}: cannot be opened: it is unplugged")

    robot = make_robot(open_bus=refuse)
    problems = _refusal(robot)
    assert [problem.partition(": ")[2] for problem in problems] == ["cannot be opened: it is unplugged"] * 2
    state, statuses = robot.read()
    assert [status.flags for status in statuses] == [SafetyFlag.BUS_OFF] * 2
    assert np.isnan(state.joint_position).all()


def test_one_channel_that_cannot_be_opened_closes_the_other(make_robot, channels):
    def refuse(address):
        if address == channels[1]:
            raise RobotError(f"{address}: cannot be opened: it is unplugged")
        return open_bus(address)

    robot = make_robot(open_bus=refuse)
    assert _refusal(robot) == [f"{channels[1]}: cannot be opened: it is unplugged"]
    assert not any(thread.name.startswith(str(channels[0])) for thread in threading.enumerate())


class _Imu:
    def __init__(self, problem=""):
        self.problem, self.calls = problem, list[str]()

    def open(self):
        self.calls.append("open")
        if self.problem:
            raise RobotError(self.problem)

    def read(self, time):
        return upright_at_rest(OK)

    def close(self):
        self.calls.append("close")


def test_an_imu_that_is_missing_is_a_problem_like_others(make_robot, left):
    robot = make_robot(imu=_Imu("/dev/ttyACM3 does not exist"))
    assert _refusal(robot) == ["imu: /dev/ttyACM3 does not exist"]
    assert left.heard == []


def test_an_imu_that_cannot_be_closed_keeps_nothing_else_open(make_robot, left):
    imu = _Imu()
    robot = make_robot(imu=imu)
    robot.activate()
    imu.close = lambda: (_ for _ in ()).throw(OSError("gone"))
    with pytest.raises(OSError, match="gone"):
        robot.close()
    assert robot.is_closed
    assert left.mode is MotorMode.RESET
    make_robot().prepare()


def test_the_imu_is_opened_read_and_closed(make_robot):
    imu = _Imu()
    robot = make_robot(imu=imu)
    robot.activate()
    state, statuses = robot.read()
    assert len(statuses) == 3
    assert state.imu_quaternion.tolist() == [1.0, 0.0, 0.0, 0.0]
    robot.close()
    assert imu.calls[-2:] == ["open", "close"]


def test_an_interrupted_activation_stops_the_motors(robot, left, right, monkeypatch):
    def interrupted(*_):
        left.mode = right.mode = MotorMode.RUN
        raise KeyboardInterrupt

    monkeypatch.setattr("humanoid_sim.hardware.adapter.robot.RobotMotors.enable", interrupted)
    with pytest.raises(KeyboardInterrupt):
        robot.activate()
    assert [left.mode, right.mode] == [MotorMode.RESET, MotorMode.RESET]
    assert not robot.is_enabled


def test_gains_of_the_description_beyond_a_motors_range_are_mentioned(description, channels, motors):
    stiff = msgspec.structs.replace(
        description,
        remote_policy_controller=RemoteSettings(damping=(6.0, 5.0)),
        standby_controller_a=msgspec.structs.replace(description.standby_controller_a, target_stiffness=(50.0, 501.0)),
    )
    robot = HardwareRobot(stiff, channels, calibration={"left": 0.0, "right": 0.0})
    robot.activate()
    assert _warnings(robot) == [
        "warning: right: standby_controller_a.target_stiffness is 501, an rs-00 is told 500 at most",
        "warning: left: remote_policy_controller's damping is 6, an rs-02 is told 5 at most",
    ]
    robot.close()


# --- what cannot be


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"host_id": 0x7F}, "host id: is 127, expected 128 to 255"),
        ({"can_timeout": 0.02}, "CAN timeout: is 0.02 s, expected more than the control period of 0.02 s"),
        ({"can_timeout": 6.0}, "and at most 5 s"),
        ({"can_timeout": 0.0}, "execute their last command for ever"),
        ({"can_timeout": float("nan")}, "CAN timeout: is nan s"),
    ],
)
def test_settings_that_cannot_be_are_refused(options, says, make_robot):
    with pytest.raises(InputError, match=says):
        make_robot(**options)


def test_a_channel_named_twice_is_refused(description):
    with pytest.raises(InputError, match="a channel is named twice"):
        HardwareRobot(description, ["virtual:a", "virtual:a"], calibration={"left": 0.0, "right": 0.0})


# --- what waits, and what falls


def test_a_robot_that_moves_is_damped_before_it_is_activated_again(robot, left, monkeypatch):
    monkeypatch.setattr(control, "_LONGEST", 0.4)
    robot.activate()
    left.velocity = 0.9
    robot.write(_damp())
    assert wait_until(lambda: abs(robot.read()[0].joint_velocity[0]) > 0.5)
    left.heard.clear()
    left.position += 0.01
    robot.activate()
    kinds = [type(command) for command in left.heard if isinstance(command, OperationControl | Stop)]
    assert kinds.index(Stop) > 10, "damped first: free arms would fall while their motors are verified"
    assert all(command.damping > 2.9 for command in left.commands[: kinds.index(Stop)])


def test_a_robot_at_rest_is_activated_again_at_once(robot, left):
    robot.activate()
    robot.write(_damp())
    assert wait_until(lambda: bool(left.commands) and left.commands[-1].damping > 2.9)
    left.heard.clear()
    robot.activate()
    assert not [command for command in left.commands if command.damping > 0.0]


def _damp():
    zeros = np.zeros(2)
    return MITCommand(zeros, zeros, zeros, zeros, np.full(2, 3.0))


@pytest.mark.usefixtures("impatient")
def test_no_enable_waits_in_a_jam_until_the_robot_was_refused(make_robot, left):
    jammed = []

    def open_jammed(address):
        bus = open_bus(address)
        send = bus.send

        def sending(message, timeout=None):
            if message.arbitration_id >> 24 == 3 and address.channel.startswith("left") and not jammed:
                jammed.append(message)
            if jammed and jammed[-1] is not None and address.channel.startswith("left"):
                raise can.CanOperationError("no buffer", error_code=errno.ENOBUFS)
            send(message, timeout)

        bus.send = sending
        return bus

    robot = make_robot(open_bus=open_jammed)
    with pytest.raises(RobotError, match="left: was not enabled"):
        robot.activate()
    left.heard.clear()
    jammed.append(None)  # the jam clears
    assert wait_until(lambda: any(isinstance(command, Stop) for command in left.heard))
    time.sleep(0.05)
    kinds = [type(command) for command in left.heard]
    assert kinds.count(Enable) <= 1, "the one that the driver had in its hands"
    assert left.mode is MotorMode.RESET
    assert kinds[-1] is not Enable


@pytest.mark.usefixtures("impatient")
def test_a_motor_that_booted_after_it_was_configured_is_refused(robot, left, right):
    def boots(command):
        if isinstance(command, Enable):  # its supply failed for a moment: what was written is lost
            left.parameters[PARAMETERS["canTimeout"].index] = bytes(4)
        return True

    left.hears = boots
    assert _refusal(robot) == ["left: has booted since it was configured: its canTimeout reads 0"]
    assert [left.mode, right.mode] == [MotorMode.RESET, MotorMode.RESET]


def test_a_position_that_jumped_is_told_at_the_next_activation(robot, left):
    robot.activate()
    robot.read()
    left.position += 0.5
    assert wait_until(lambda: not robot.read()[1][0].is_ok)
    robot.activate()
    assert _warnings(robot) == [
        "warning: left: its position jumped before: compare it with this list, and calibrate if it differs"
    ]


def test_nothing_comes_between_a_motors_enabling_and_its_command_without_torque(description, left, right):
    """Firmware that keeps its last command obeys it until then."""
    heard = []

    def remember(command):
        heard.append((command.motor_id, type(command)))
        return True

    left.hears = right.hears = remember
    channel = BusAddress("virtual", "one-by-one")
    robot = HardwareRobot(description, [channel], calibration={"left": 0.0, "right": 0.0}, can_timeout=1.0)
    with ScriptedMotors([(channel, [left, right])]), contextlib.closing(robot):
        robot.activate()
    for motor in (left, right):
        enabled = heard.index((motor.motor_id, Enable))
        assert {heard[enabled - 1], heard[enabled + 1]} == {(motor.motor_id, OperationControl)}
