import pytest

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.bus.address import parse_address
from humanoid_sim.hardware.emulation import firmware
from humanoid_sim.hardware.emulation.faults import Fault
from humanoid_sim.hardware.emulation.settings import EmulationSettings
from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.hardware.robstride.messages import MotorMode
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.tools.bench import open_bench, read_value, some_motors
from humanoid_sim.hardware.tools.enabled_motor import EnabledMotor
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.motors import MOTORS

_ADDRESS = parse_address("virtual:bench-client")


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
        motors.call(lambda emulator: told.append(emulator.motors.states[4].command))
    command = told[0]
    assert here < command.position < here + 0.07, "0.5 N·m at 10 N·m/rad"


def test_a_motor_that_does_not_confirm_its_stop_is_said(bench, motors, inject):
    motor = EnabledMotor(bench)
    with pytest.raises(RobotError, match="does not confirm that it stopped; without commands it stops by itself"):  # noqa: SIM117
        with motor:
            inject(motors, Fault("silent", ("left_wrist_yaw",)))


@pytest.mark.soak
@pytest.mark.parametrize("is_taken", [True, False])
def test_a_timeout_that_cannot_be_read_is_tried_out_without_torque(monkeypatch, is_taken):
    """Manuals that have 0x7021 to 0x7029 as write-only: the motor must have stopped by itself before it is driven."""
    told, known, hidden = [], firmware.written_parameters, PARAMETERS["canTimeout"].index
    if not is_taken:
        deaf = lambda state, i, value: known(state, 0 if i == hidden else i, value)  # noqa: E731
        monkeypatch.setattr(firmware, "written_parameters", deaf)
    settings, group = EmulationSettings(write_only=True), some_motors([(0, 15)], [str(_ADDRESS)], MOTORS["rs-05"])
    with (
        VirtualMotors(
            load_robot("lite"), [_ADDRESS], settings=settings, told=lambda _, text: told.append(text)
        ) as motors,
        open_bench([_ADDRESS], 0xFD, group, open_channel=motors.open_bus) as channels,
    ):
        if is_taken:
            with EnabledMotor(channels, torque=1.0) as motor:
                assert motor.command(motor.status.position, 0.0, 5.0, 0.5).mode is MotorMode.RUN
        else:
            with pytest.raises(RobotError, match="does not tell its CAN timeout, and was not seen to stop 150 ms"):
                EnabledMotor(channels, torque=1.0).__enter__()
        assert _nothing_runs(motors)
    words = [text.removeprefix("left_wrist_yaw: ") for text in told]
    once = ["enabled", "stopped, in reset mode"]
    assert (words[-4:] == once * 2) if is_taken else (words == once)


def _nothing_runs(motors, *, nor_was_written=False):
    states, timeout = [], PARAMETERS["canTimeout"].index
    motors.call(lambda emulator: states.extend(emulator.motors.states))
    return not any(state.is_running or (nor_was_written and state.parameters[timeout] != 0) for state in states)


def _nothing_was_written(motors):
    return _nothing_runs(motors, nor_was_written=True)


def test_a_motor_that_another_master_drives_is_not_touched(bench, motors, inject):
    inject(motors, Fault("other_master"))
    with pytest.raises(RobotError, match="another master drives these motors: another host sends"), EnabledMotor(bench):
        pass
    assert _nothing_was_written(motors)
