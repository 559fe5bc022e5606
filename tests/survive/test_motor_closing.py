"""How a robot is left: damped, disabled, verified by the motors themselves, or a person is asked to cut the power."""

import pytest
from wire_motor import ENABLE, OPERATION, RESET, RUN, STOP
from wire_rig import Pair, hold

from humanoid_sim.errors import RobotError


@pytest.fixture
def pair(tmp_path, monkeypatch):
    with Pair(tmp_path, monkeypatch) as pair:
        yield pair


@pytest.fixture
def holding(pair):
    """The robot, held with stiffness; the log begins afterwards."""
    robot = pair.active()
    pair.command(robot, hold())
    pair.log.clear()
    return robot


def test_a_robot_that_holds_is_damped_and_then_disabled(pair, holding):
    holding.close()
    for motor in pair.motors:
        frames = pair.sent(motor, OPERATION, STOP)
        damping, stops = [f.operation for f in frames if f.operation], [f for f in frames if f.is_stop]
        assert damping
        assert stops
        assert frames.index(stops[0]) == len(damping), "damped first"
        for command in damping:
            assert (command.velocity, command.effort, command.kp) == (0.0, 0.0, 0.0)
            assert command.kd == pytest.approx(3.0, abs=1e-3)
        assert motor.mode == RESET


@pytest.mark.parametrize("fault", [{"refuses": {STOP}}, {"is_silent": True}, {"ignores": {STOP}}], ids=str)
def test_where_a_motor_does_not_confirm_a_person_is_asked_to_switch_the_power_off(fault, pair, holding):
    for name, value in fault.items():
        setattr(pair.left, name, value)
    pair.waits(answers=0.03)
    with pytest.raises(RobotError, match=r"left.*power") as caught:
        holding.close()
    assert "right" not in str(caught.value)
    assert len([f for f in pair.sent(pair.left, STOP) if f.is_stop]) > 1, "once more, for a lost frame"
    assert pair.right.mode == RESET


def test_what_counts_is_the_mode_that_a_motor_reports_and_not_that_it_answers(pair, holding):
    """A status that was on its way confirms nothing."""
    stops = []

    def late(frame):
        if frame.is_stop:
            stops.append(frame)
            pair.left.refuses = {STOP} if len(stops) < 2 else set()

    pair.left.on_frame = late
    pair.waits(answers=0.1)
    holding.close()
    assert len(stops) == 2
    assert pair.left.mode == RESET


def test_closing_twice_is_closing_once(pair, holding):
    holding.close()
    pair.log.clear()
    holding.close()
    assert pair.log == []
    with pytest.raises(RobotError, match="closed"):
        holding.activate()
    with pytest.raises(RobotError, match="closed"):
        holding.write(hold())
    assert all(not status.is_ok for status in holding.read()[1])
    assert pair.log == []


def test_a_robot_that_was_never_activated_is_closed_without_a_frame(pair):
    pair.robot().close()
    assert pair.log == []


def test_the_close_after_a_failed_activation_answers_for_a_motor_that_may_still_run(pair):
    robot = pair.robot()
    pair.left.refuses = {ENABLE}

    def unplugged(frame):
        pair.right.is_silent |= frame.kind == ENABLE

    pair.right.on_frame = unplugged
    pair.waits(answers=0.03)
    with pytest.raises(RobotError, match="left"):
        robot.activate()
    with pytest.raises(RobotError, match=r"right.*power"):
        robot.close()
    assert pair.left.mode == RESET


def test_the_close_after_a_failed_reactivation_disables_a_motor_that_is_found_again(pair, holding):
    pair.left.is_silent = True
    pair.waits(answers=0.03)
    with pytest.raises(RobotError, match="left"):
        holding.activate()
    assert (pair.left.mode, pair.right.mode) == (RUN, RESET)
    pair.left.is_silent = False
    pair.waits()
    holding.close()
    assert pair.left.mode == RESET
