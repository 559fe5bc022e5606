import threading
import time

import numpy as np
import pytest
from waiting import wait_until

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.adapter import control
from humanoid_sim.hardware.robstride import requests
from humanoid_sim.hardware.robstride.messages import MotorMode, OperationControl, Stop
from humanoid_sim.mit import MITCommand


def _hold(stiffness=50.0, damping=2.0):
    zeros = np.zeros(2)
    return MITCommand(np.array([-0.25, 0.5]), zeros, zeros, np.full(2, stiffness), np.full(2, damping))


def test_a_robot_that_holds_is_damped_and_then_disabled(robot, left, right, monkeypatch):
    monkeypatch.setattr(control, "_LONGEST", 2.0)
    robot.activate()
    robot.write(_hold())
    assert wait_until(lambda: bool(left.commands))
    left.heard.clear()
    robot.close()
    kinds = [type(command) for command in left.heard if isinstance(command, OperationControl | Stop)]
    assert kinds[-1] is Stop
    assert kinds.count(OperationControl) > 10, "half a second at rest, at least"
    for command in left.commands[1:]:
        assert (command.stiffness, command.effort) == (0.0, 0.0)
        assert command.damping == pytest.approx(3.0, abs=1e-3)
    assert [left.mode, right.mode] == [MotorMode.RESET, MotorMode.RESET]
    assert not left.reports
    assert robot.is_closed


def test_a_moving_joint_is_damped_for_two_seconds_at_most(robot, left, monkeypatch):
    monkeypatch.setattr(control, "_LONGEST", 0.2)
    left.velocity = 3.0
    robot.activate()
    robot.write(_hold(0.0))
    begin = time.monotonic()
    robot.close()
    assert 0.2 < time.monotonic() - begin < 1.5
    assert left.mode is MotorMode.RESET


@pytest.mark.parametrize("command", [None, MITCommand.zeros(2), _hold(0.0, 3.0)])
def test_a_robot_that_is_limp_or_rests_in_damping_is_disabled_at_once(command, robot, left):
    robot.activate()
    left.heard.clear()
    if command is not None:
        robot.write(command)
        assert wait_until(lambda: bool(left.commands))
    robot.close()
    assert len(left.commands) == (command is not None)
    assert left.mode is MotorMode.RESET


@pytest.mark.usefixtures("impatient")
def test_a_motor_that_does_not_confirm_is_named(make_robot, left, right):
    robot = make_robot()
    robot.activate()
    left.stops = False
    with pytest.raises(
        RobotError, match=r"not confirmed to be disabled: left \(mode run\)\. .*100 ms; switch the power"
    ):
        robot.close()
    assert right.mode is MotorMode.RESET
    assert not any("virtual:" in thread.name for thread in threading.enumerate() if "motors" not in thread.name)


@pytest.mark.soak
@pytest.mark.usefixtures("impatient")
def test_the_channels_are_free_after_a_close_that_failed(make_robot, left):
    first = make_robot()
    first.activate()
    left.is_silent = True
    with pytest.raises(RobotError, match="not confirmed to be disabled: left"):
        first.close()
    left.is_silent = False
    make_robot().prepare()


def test_a_robot_is_closed_when_its_motors_are_disabled_and_not_before(robot, left):
    seen = []

    def stopped(command):
        if isinstance(command, Stop):
            seen.append(robot.is_closed)
        return True

    robot.activate()
    left.hears = stopped
    robot.close()
    assert seen == [False]
    assert robot.is_closed


def test_closing_twice_is_closing_once(robot, left):
    robot.activate()
    robot.close()
    left.heard.clear()
    robot.close()
    assert left.heard == []


def test_a_closed_robot_refuses_commands_and_activation_but_can_be_read(robot):
    robot.activate()
    robot.close()
    with pytest.raises(RobotError, match="the robot is closed"):
        robot.write(_hold())
    with pytest.raises(RobotError, match="the robot is closed"):
        robot.activate()
    state, statuses = robot.read()
    assert np.isfinite(state.joint_position).all()
    assert all(status.message == "closed" for status in statuses)


def test_a_robot_that_was_never_activated_is_closed_without_a_word(robot, left):
    robot.close()
    assert left.heard == []


def test_an_impatient_interrupt_still_disables(robot, left, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    robot.activate()
    robot.write(_hold())
    monkeypatch.setattr("humanoid_sim.hardware.adapter.robot.damp_until_rest", interrupted)
    with pytest.raises(KeyboardInterrupt):
        robot.close()
    assert left.mode is MotorMode.RESET
    assert robot.is_closed
    robot.close()


def _moving_while_answers_are_lost(robot, left):
    """Left sinks in DAMPING; the last that was heard of it is that it did not move."""
    robot.activate()
    robot.write(_hold(0.0, 3.0))
    assert wait_until(lambda: bool(left.commands))
    left.answers = False
    assert wait_until(lambda: robot.read()[0].joint_age[0] > 0.25)
    left.heard.clear()


@pytest.mark.soak
def test_a_silent_joint_is_not_taken_to_rest(robot, left, monkeypatch):
    monkeypatch.setattr(control, "_LONGEST", 0.7)
    _moving_while_answers_are_lost(robot, left)
    monkeypatch.setattr(requests, "_ANSWER_TIMES", (0.03,))
    with pytest.raises(RobotError, match="not confirmed to be disabled: left"):
        robot.close()
    damping = [command for command in left.commands if command.damping > 2.9]
    assert len(damping) > 25, "for as long as damping lasts, although the last velocity heard was 0"
    assert left.mode is MotorMode.RESET


@pytest.mark.soak
@pytest.mark.usefixtures("impatient")
def test_a_motor_lost_in_a_reactivation_is_answered_for_at_the_end(robot, left):
    robot.activate()
    robot.write(_hold())
    left.is_silent = True  # unplugged from the bus: it goes on with its last command
    with pytest.raises(RobotError, match="left: does not confirm that it is disabled"):
        robot.activate()
    with pytest.raises(RobotError, match="not confirmed to be disabled: left"):
        robot.close()
    assert left.mode is MotorMode.RUN


def test_a_motor_found_again_after_a_refused_reactivation_is_disabled(robot, left, monkeypatch):
    robot.activate()
    left.is_silent = True
    with monkeypatch.context() as patch:
        patch.setattr(requests, "_ANSWER_TIMES", (0.03,))
        with pytest.raises(RobotError, match="left: motor 11 does not answer"):
            robot.activate()
    left.is_silent = False
    assert left.mode is MotorMode.RUN
    robot.close()
    assert left.mode is MotorMode.RESET
