import numpy as np
import pytest

from humanoid_sim.errors import RobotError
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.robot import LoopbackRobot


def command(value: float, n: int = 14) -> MITCommand:
    ones = np.ones(n)
    return MITCommand(value * ones, 2 * value * ones, 3 * value * ones, ones, ones)


def test_starts_at_the_initial_position() -> None:
    robot = LoopbackRobot(load_robot("lite"))
    state, safety = robot.read()
    assert state.time == 0.0
    assert state.joint_position.tolist() == list(load_robot("lite").initial_position)
    assert [status.is_ok for status in safety] == [True]


def test_the_state_is_the_last_command() -> None:
    robot = LoopbackRobot(load_robot("lite"), control_period=0.02)
    robot.write(command(1.0))
    robot.write(command(2.0))
    state, _ = robot.read()
    assert state.time == 0.04
    assert state.joint_position.tolist() == [2.0] * 14
    assert state.joint_velocity.tolist() == [4.0] * 14
    assert state.joint_effort.tolist() == [6.0] * 14
    assert state.joint_age.tolist() == [0.0] * 14


def test_activation_goes_back_to_the_start_but_time_goes_on() -> None:
    robot = LoopbackRobot(load_robot("lite"))
    robot.write(command(1.0))
    robot.activate()
    state, _ = robot.read()
    assert state.time == 0.005
    assert state.joint_position.tolist() == list(load_robot("lite").initial_position)


def test_refuses_a_wrong_joint_count_and_a_closed_robot() -> None:
    robot = LoopbackRobot(load_robot("lite"))
    with pytest.raises(RobotError, match=r"shape \(17,\), expected \(14,\)"):
        robot.write(command(1.0, 17))
    robot.close()
    robot.close()
    with pytest.raises(RobotError, match="closed"):
        robot.write(command(1.0))
    with pytest.raises(RobotError, match="closed"):
        robot.activate()
