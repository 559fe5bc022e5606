from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.bus.address import parse_address
from humanoid_sim.hardware.bus.lock import ChannelLock
from humanoid_sim.hardware.cli.client import MotorClient, SilentMotorError
from humanoid_sim.hardware.cli.enabled_motor import EnabledMotor
from humanoid_sim.hardware.cli.exchange import read_device_id, read_value, read_values
from humanoid_sim.hardware.emulation.faults import Fault
from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.hardware.robstride.faults import MotorMode
from humanoid_sim.hardware.robstride.models import MODELS
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.robots.description import load_robot

_ADDRESS = parse_address("virtual:bench-client")


@pytest.fixture
def motors() -> Iterator[VirtualMotors]:
    with VirtualMotors(load_robot("lite"), [_ADDRESS]) as motors:
        yield motors


@pytest.fixture
def client(motors: VirtualMotors) -> Iterator[MotorClient]:
    with MotorClient(_ADDRESS, host_id=0xFD, models={15: MODELS["rs-05"]}, open_channel=motors.open_bus) as client:
        yield client


def test_a_lost_frame_is_asked_for_again(client: MotorClient, motors: VirtualMotors) -> None:
    motors.inject(Fault("lost", ("left_wrist_yaw",), value=1.0, start=0.0, duration=motors.time + 0.05))
    assert len(read_device_id(client, 15).uid) == 8


def test_a_late_answer_is_not_the_next_questions(client: MotorClient, motors: VirtualMotors) -> None:
    motors.inject(Fault("delayed", ("left_wrist_yaw",), value=0.06))
    assert read_values(client, [15], PARAMETERS["VBUS"], 0.02) == {}
    assert read_value(client, 15, PARAMETERS["canTimeout"]) == 0


def test_motors_that_are_silent_are_left_out(client: MotorClient, motors: VirtualMotors) -> None:
    motors.inject(Fault("silent", ("left_wrist_yaw",)))
    assert read_values(client, [14, 15, 16], PARAMETERS["VBUS"], 0.1) == {14: 48.0, 16: 48.0}


def test_a_bus_that_is_down_is_an_error_and_says_why(client: MotorClient, motors: VirtualMotors) -> None:
    motors.inject(Fault("bus_off"))
    for _ in range(2):
        with pytest.raises((RobotError, SilentMotorError), match=r"bus-off|Network is down"):
            read_device_id(client, 15)


def test_silence_says_what_the_channel_knows_of_it(client: MotorClient, motors: VirtualMotors) -> None:
    motors.inject(Fault("enobufs"))
    with pytest.raises(
        SilentMotorError, match=r"motor 15 does not answer on virtual:bench-client \(outgoing queue is full"
    ):
        read_device_id(client, 15)


def test_a_motor_is_enabled_within_the_context_only(client: MotorClient) -> None:
    with EnabledMotor(client, 15) as motor:
        assert motor.status is not None
        assert motor.status.mode is MotorMode.RUN
        position = motor.command(0.0, 0.0, 0.0, 0.0).position
        assert motor.command(position, 0.0, 5.0, 0.5).mode is MotorMode.RUN
        assert read_value(client, 15, PARAMETERS["canTimeout"]) == 2000
    assert read_value(client, 15, PARAMETERS["canTimeout"]) == 0
    with pytest.raises(RobotError, match="motor 15 on virtual:bench-client: is in mode reset, expected run"):
        motor.command(position, 0.0, 5.0, 0.5)


def test_a_motor_that_does_not_confirm_its_stop_is_said(client: MotorClient, motors: VirtualMotors) -> None:
    motor = EnabledMotor(client, 15)
    with pytest.raises(RobotError, match="does not confirm that it stopped; without commands it stops by itself"):  # noqa: SIM117
        with motor:
            motors.inject(Fault("silent", ("left_wrist_yaw",)))


def test_a_motor_that_loses_its_mode_is_noticed(client: MotorClient, motors: VirtualMotors) -> None:
    with EnabledMotor(client, 15) as motor:
        motors.inject(Fault("reset", ("left_wrist_yaw",)))
        time.sleep(0.01)
        with pytest.raises(RobotError, match="is in mode reset, expected run"):
            motor.command(0.0, 0.0, 0.0, 0.0)


def test_a_client_that_cannot_open_its_channel_gives_it_back() -> None:
    def refuse(_: object) -> None:
        raise RobotError("cannot be opened")

    with pytest.raises(RobotError, match="cannot be opened"):
        MotorClient(_ADDRESS, host_id=0xFD, open_channel=refuse)  # type: ignore[arg-type]
    ChannelLock(_ADDRESS).release()
