"""Bringing motors up: nobody is touched before all are known, and nobody is enabled who could not be stopped."""

import math
import struct

import pytest
from motor_surface import make_robot
from wire_motor import (
    CAN_TIMEOUT,
    ENABLE,
    FAULT_WORD,
    GET_ID,
    LIMIT_TORQUE,
    OPERATION,
    READ,
    RESET,
    RUN,
    RUN_MODE,
    WRITE,
    Operation,
    WireMotor,
    identifier,
    operation_frame,
)
from wire_rig import Pair, at_motor, hold, robot_document, wrapped, write_calibration

from humanoid_sim.errors import InputError, RobotError

TICKS = 2000
"""The CAN timeout of 0.1 s, as it stands in a motor."""


@pytest.fixture
def pair(tmp_path, monkeypatch):
    with Pair(tmp_path, monkeypatch) as pair:
        yield pair


def refusal(robot):
    with pytest.raises(RobotError) as caught:
        robot.activate()
    return str(caught.value)


# --- identification


def test_every_motor_is_identified_before_any_is_touched(pair):
    """`right` answers only the second time that it is asked; `left` waits for it."""
    questions = []

    def late(frame):
        questions.append(frame.kind)
        pair.right.ignores = {GET_ID} if questions.count(GET_ID) < 2 else set()

    pair.right.on_frame = late
    pair.robot().activate()
    kinds = [(frame.motor, frame.kind, frame.is_reply) for frame in pair.log]
    identified = max(kinds.index((11, GET_ID, True)), kinds.index((21, GET_ID, True)))
    assert all(frame.is_question or frame.is_reply for frame in pair.log[:identified])
    assert [motor.mode for motor in pair.motors] == [RUN, RUN]


def test_a_missing_motor_keeps_every_motor_from_being_touched(pair):
    pair.right.is_silent = True
    pair.waits(answers=0.03)
    message = refusal(pair.robot())
    for part in ("right", "21", pair.channels[1]):
        assert part in message
    assert "left" not in message
    assert pair.touched == []
    assert pair.left.mode == RESET


@pytest.mark.parametrize("where", [0, 1])
def test_two_motors_with_one_id_are_refused(where, pair):
    pair.waits(listening=0.05)
    pair.buses[where].motors.append(WireMotor(11, uid=b"a twin!!"))
    message = refusal(pair.robot())
    assert "left" in message
    assert "11" in message
    assert pair.touched == []


DRIVES = operation_frame(11, "rs-02", Operation(0.0, 0.0, 0.0, 20.0, 1.0))
ENABLES = identifier(ENABLE, 0xFE, 11), bytes(8)


@pytest.mark.parametrize("chatter", [DRIVES, ENABLES], ids=["operation control", "enable"])
def test_motors_that_another_master_drives_are_left_alone(chatter, pair):
    """They are not even stopped: arms would fall."""
    pair.waits(listening=0.05)
    pair.buses[0].chatter = chatter
    assert pair.channels[0] in refusal(pair.robot())
    assert all(frame.is_question for frame in pair.log)
    pair.buses[0].chatter = None


@pytest.mark.parametrize(
    ("version", "reason"),
    [((0, 0, 3, 6), "rs-00"), ((0, 2, 3, 5), "1.4167"), ((0, 2, 9, 0), "0.2.9.0")],
    ids=["of another model", "that multiplies gains", "that no document mentions"],
)
def test_a_motor_with_firmware_of_the_wrong_kind_is_not_enabled(version, reason, pair):
    pair.left.version = bytes(version)
    message = refusal(pair.robot())
    assert "left" in message
    assert reason in message
    assert not [frame for frame in pair.log if frame.kind == ENABLE]


def test_a_motor_that_was_exchanged_between_two_activations_is_refused(pair):
    robot = pair.robot()
    robot.activate()
    pair.left.uid = b"another!"
    pair.log.clear()
    assert "left" in refusal(robot)
    assert pair.touched == []
    assert [motor.mode for motor in pair.motors] == [RESET, RESET]


def test_another_robots_calibration_is_refused(pair):
    path = write_calibration(pair.folder / "other.yaml")
    path.write_text(path.read_text().replace("id: 11", "id: 12"))
    with pytest.raises(InputError, match=r"left: id: is 12.* 11"):
        pair.robot(calibration=path)


def test_a_channel_has_one_session_at_a_time(pair):
    first, second = pair.robot(), pair.robot()
    first.activate()
    pair.log.clear()
    message = refusal(second)
    assert all(channel in message for channel in pair.channels)
    assert all(frame.kind == OPERATION for frame in pair.log if not frame.is_reply)
    first.close()
    second.activate()


# --- configuration


@pytest.mark.parametrize(
    ("fault", "part"),
    [
        ({"keeps": {RUN_MODE}, "parameters": {RUN_MODE: b"\3\0\0\0"}}, "run_mode"),
        ({"keeps": {CAN_TIMEOUT}}, "canTimeout"),
        ({"keeps": {LIMIT_TORQUE}}, "limit_torque"),
        ({"unreadable": {RUN_MODE}}, "run_mode"),
        ({"unreadable": {LIMIT_TORQUE}}, "limit_torque"),
        ({"faults": 1 << 0, "refuses": {4}, "mode": RUN}, "stop"),
        ({"parameters": {FAULT_WORD: struct.pack("<I", 1 << 3)}}, "overvoltage"),
        ({"position": at_motor("left", 1.6)}, "1.6"),
        ({"counted": at_motor("left", -0.25) + 8.0 * math.pi}, "turn"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_motor_that_is_not_as_it_must_be_is_not_enabled(fault, part, pair):
    for name, value in fault.items():
        setattr(pair.left, name, pair.left.parameters | value if name == "parameters" else value)
    pair.waits(answers=0.03)
    message = refusal(pair.robot())
    assert "left" in message
    assert part in message
    assert not [frame for frame in pair.log if frame.kind == ENABLE]


def test_the_can_timeout_is_set_before_enabling_and_read_again_afterwards(pair):
    pair.robot().activate()
    for motor in pair.motors:
        frames = pair.sent(motor, ENABLE, READ, WRITE)
        enabled = [i for i, frame in enumerate(frames) if frame.kind == ENABLE]
        about = [i for i, frame in enumerate(frames) if frame.kind != ENABLE and frame.index == CAN_TIMEOUT]
        assert [frames[i].kind for i in about][:2] == [WRITE, READ]
        assert struct.unpack("<I", frames[about[0]].data[4:]) == (TICKS,)
        assert about[1] < enabled[0]
        assert frames[about[-1]].kind == READ
        assert about[-1] > enabled[-1]


@pytest.mark.parametrize("value", [bytes(4), None], ids=["lost", "not readable"])
def test_a_motor_that_lost_its_can_timeout_as_it_was_enabled_is_stopped_again(value, pair):
    """Its supply failed for a moment: it would execute its last command for ever."""

    def boots(frame):
        if frame.kind == ENABLE and value is None:
            pair.left.unreadable.add(CAN_TIMEOUT)
        elif frame.kind == ENABLE:
            pair.left.parameters[CAN_TIMEOUT] = value

    pair.left.on_frame = boots
    pair.waits(answers=0.05)
    message = refusal(pair.robot())
    assert "left" in message
    assert "canTimeout" in message
    assert [motor.mode for motor in pair.motors] == [RESET, RESET]


def test_a_motor_that_hides_its_can_timeout_must_show_it_by_stopping(pair):
    """This one runs on in a silence that is longer."""
    pair.left.unreadable.add(CAN_TIMEOUT)
    message = refusal(pair.robot(can_timeout=0.05))
    assert "left" in message
    assert "timeout" in message.lower()
    assert all(command.is_limp for command in pair.commands(pair.left))
    assert [motor.mode for motor in pair.motors] == [RESET, RESET]


@pytest.mark.parametrize("can_timeout", [0.02, 0.0, 6.0, float("nan")])
def test_a_can_timeout_that_protects_nobody_is_refused(can_timeout, pair):
    with pytest.raises(InputError, match="timeout"):
        pair.robot(can_timeout=can_timeout)


def test_motors_without_a_timeout_of_their_own_are_refused_unless_that_is_accepted(tmp_path):
    document = robot_document()
    document["joints"][1]["motor"] = {"family": "sito", "bus": 1, "can_id": 21, "model": "TA40-50", "direction": 1}
    settings = document, ["virtual:survive-sito-a", "virtual:survive-sito-b"], write_calibration(tmp_path / "c.yaml")
    with pytest.raises(InputError, match=r"right.*allow-no-timeout"):
        make_robot(*settings, lambda: 0.0)
    make_robot(*settings, lambda: 0.0, allow_no_timeout=True).close()


# --- enabling


def test_each_motor_is_enabled_limp_one_after_the_other(tmp_path, monkeypatch):
    """Old firmware keeps its last command: a command without torque comes right before and right after each enable."""
    with Pair(tmp_path, monkeypatch, one_channel=True) as pair:
        pair.robot().activate()
        frames = [frame for frame in pair.log if not frame.is_reply]
        enabled = [i for i, frame in enumerate(frames) if frame.kind == ENABLE]
        assert {frames[i].motor for i in enabled} == {11, 21}
        for i in enabled:
            for neighbour in (frames[i - 1], frames[i + 1]):
                assert neighbour.motor == frames[i].motor
                assert neighbour.operation is not None
        for motor in pair.motors:
            commands = pair.commands(motor)
            assert all(command.is_limp for command in commands)
            assert all(command.position == pytest.approx(motor.position, abs=2e-3) for command in commands)


def _ignores_enable(motor):
    motor.refuses.add(ENABLE)


def _fails_as_it_is_enabled(motor):
    def fail(frame):
        motor.faults |= (frame.kind == ENABLE) << 1

    motor.on_frame = fail


@pytest.mark.parametrize("fails", [_ignores_enable, _fails_as_it_is_enabled])
def test_one_motor_that_cannot_be_enabled_takes_all_down_again(fails, pair):
    fails(pair.left)
    pair.waits(answers=0.05)
    assert "left" in refusal(pair.robot())
    assert pair.sent(pair.right, ENABLE), "it ran"
    assert [motor.mode for motor in pair.motors] == [RESET, RESET]
    for motor in pair.motors:
        assert [frame for frame in pair.log if frame.motor == motor.motor_id and not frame.is_reply][-1].is_stop


# --- turns


@pytest.mark.parametrize("turns", [-1, 0, 1])
@pytest.mark.parametrize("joint", ["left", "right"])
def test_a_motor_that_boots_on_another_turn_reads_the_calibrated_angle(joint, turns, pair):
    motor, angle = getattr(pair, joint), {"left": -1.2, "right": 1.7}[joint]
    motor.position = at_motor(joint, angle) + 2.0 * math.pi * turns
    robot = pair.active()
    state, statuses = pair.answered(robot)
    i = robot.joints.index(joint)
    assert state.joint_position[i] == pytest.approx(angle, abs=1e-3)
    assert all(status.is_ok for status in statuses)
    command = [-0.25, 0.5]
    command[i] = angle
    pair.command(robot, hold(*command))
    assert pair.commands(motor)[-1].position == pytest.approx(motor.position, abs=2e-3), "in the motor's own count"


def test_a_joint_left_below_zero_boots_near_a_whole_turn(pair):
    """At power-on a motor knows its angle within one turn only."""
    pair.right.position = wrapped(at_motor("right", -0.1))
    assert pair.right.position > 5.0
    state, _ = pair.answered(pair.active())
    assert state.joint_position[1] == pytest.approx(-0.1, abs=1e-3)
