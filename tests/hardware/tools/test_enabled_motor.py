import pytest

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.mock.faults import Fault
from humanoid_sim.hardware.robstride.messages import MotorMode
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.tools.bench import read_value
from humanoid_sim.hardware.tools.enabled_motor import EnabledMotor


def test_a_motor_is_enabled_within_the_context_only(bench):
    with EnabledMotor(bench, torque=2.0) as motor:
        assert motor.status.mode is MotorMode.RUN
        position = motor.command(0.0, 0.0, 0.0, 0.0).position
        assert motor.command(position, 0.0, 5.0, 0.5).mode is MotorMode.RUN
        assert read_value(bench, PARAMETERS["canTimeout"]) == 2000
        assert read_value(bench, PARAMETERS["limit_torque"]) == 2.0
    assert read_value(bench, PARAMETERS["canTimeout"]) == 0
    assert read_value(bench, PARAMETERS["limit_torque"]) == 5.5
    with pytest.raises(RobotError, match="motor 15 on virtual:bench-client: is in mode reset, expected run"):
        motor.command(position, 0.0, 5.0, 0.5)


def test_what_a_motor_is_told_stays_within_the_torque_that_was_allowed(bench, motors):
    """Also where its own torque limit were none, which no document rules out for these commands."""
    told = []
    with EnabledMotor(bench, torque=0.5) as motor:
        here = motor.status.position
        motor.command(here + 1.0, 0.0, 10.0, 0.1)
        motors.call(lambda mock: told.append(mock.motors[4].command))
    command = told[0]
    assert here < command.position < here + 0.07, "0.5 N·m at 10 N·m/rad"


def test_a_motor_that_does_not_confirm_its_stop_is_said(bench, motors, inject):
    motor = EnabledMotor(bench)
    with pytest.raises(RobotError, match="does not confirm that it stopped; without commands it stops by itself"):  # noqa: SIM117
        with motor:
            inject(motors, Fault("silent", ("left_wrist_yaw",)))


def _nothing_runs(motors, *, nor_was_written=False):
    states, timeout = [], PARAMETERS["canTimeout"].index
    motors.call(lambda mock: states.extend(mock.motors))
    return not any(state.is_running or (nor_was_written and state.parameters[timeout] != 0) for state in states)


def _nothing_was_written(motors):
    return _nothing_runs(motors, nor_was_written=True)


def test_a_motor_that_another_master_drives_is_not_touched(bench, motors, inject):
    inject(motors, Fault("second_master"))
    with pytest.raises(RobotError, match="another master drives these motors: another host sends"), EnabledMotor(bench):
        pass
    assert _nothing_was_written(motors)
