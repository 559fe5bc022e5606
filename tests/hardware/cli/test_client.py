from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import pytest

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.bus.address import parse_address
from humanoid_sim.hardware.bus.lock import ChannelLock
from humanoid_sim.hardware.cli.client import MotorClient, SilentMotorError
from humanoid_sim.hardware.cli.enabled_motor import EnabledMotor
from humanoid_sim.hardware.cli.exchange import poll_values, read_device_id, read_value, read_values
from humanoid_sim.hardware.emulation.faults import Fault
from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.hardware.robstride.faults import MotorMode
from humanoid_sim.hardware.robstride.messages import Command
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.motors import MOTORS

Inject = Callable[[VirtualMotors, Fault], None]

_ADDRESS = parse_address("virtual:bench-client")


@pytest.fixture
def motors() -> Iterator[VirtualMotors]:
    with VirtualMotors(load_robot("lite"), [_ADDRESS]) as motors:
        yield motors


@pytest.fixture
def client(motors: VirtualMotors) -> Iterator[MotorClient]:
    with MotorClient(_ADDRESS, host_id=0xFD, models={15: MOTORS["rs-05"]}, open_channel=motors.open_bus) as client:
        yield client


def test_a_lost_question_is_asked_again(client: MotorClient, monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[Command] = []
    send = client.send

    def send_all_but_the_first(command: Command) -> None:
        sent.append(command)
        if len(sent) > 1:
            send(command)

    monkeypatch.setattr(client, "send", send_all_but_the_first)
    assert len(read_device_id(client, 15).uid) == 8
    assert sent[1] == sent[0]


def test_a_late_answer_is_not_the_next_questions(client: MotorClient, motors: VirtualMotors, inject: Inject) -> None:
    inject(motors, Fault("delayed", ("left_wrist_yaw",), value=0.06))
    assert read_values(client, [15], PARAMETERS["VBUS"], 0.02) == {}
    assert read_value(client, 15, PARAMETERS["canTimeout"]) == 0


def test_polling_takes_late_answers_the_next_time(client: MotorClient, motors: VirtualMotors, inject: Inject) -> None:
    inject(motors, Fault("delayed", ("left_wrist_yaw",), value=0.06))
    begin = time.monotonic()
    polled: dict[int, float] = {}
    while not polled and time.monotonic() < begin + 5.0:
        polled = poll_values(client, [15], PARAMETERS["VBUS"], 0.01)
    assert polled == {15: 48.0}


def test_motors_that_are_silent_are_left_out(client: MotorClient, motors: VirtualMotors, inject: Inject) -> None:
    inject(motors, Fault("silent", ("left_wrist_yaw",)))
    assert read_values(client, [14, 15, 16], PARAMETERS["VBUS"], 0.1) == {14: 48.0, 16: 48.0}


def test_a_bus_that_is_down_is_an_error_and_says_why(
    client: MotorClient, motors: VirtualMotors, inject: Inject
) -> None:
    inject(motors, Fault("bus_off"))
    for _ in range(2):
        with pytest.raises((RobotError, SilentMotorError), match=r"bus-off|Network is down"):
            read_device_id(client, 15)


def test_silence_says_what_the_channel_knows_of_it(client: MotorClient, motors: VirtualMotors, inject: Inject) -> None:
    inject(motors, Fault("enobufs"))
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


def test_a_motor_that_does_not_confirm_its_stop_is_said(
    client: MotorClient, motors: VirtualMotors, inject: Inject
) -> None:
    motor = EnabledMotor(client, 15)
    with pytest.raises(RobotError, match="does not confirm that it stopped; without commands it stops by itself"):  # noqa: SIM117
        with motor:
            inject(motors, Fault("silent", ("left_wrist_yaw",)))


def test_a_motor_that_loses_its_mode_is_noticed(client: MotorClient, motors: VirtualMotors, inject: Inject) -> None:
    with EnabledMotor(client, 15) as motor:
        inject(motors, Fault("reset", ("left_wrist_yaw",)))
        with pytest.raises(RobotError, match="is in mode reset, expected run"):
            motor.command(0.0, 0.0, 0.0, 0.0)


def test_a_client_that_cannot_open_its_channel_gives_it_back() -> None:
    def refuse(_: object) -> None:
        raise RobotError("cannot be opened")

    with pytest.raises(RobotError, match="cannot be opened"):
        MotorClient(_ADDRESS, host_id=0xFD, open_channel=refuse)  # type: ignore[arg-type]
    ChannelLock(_ADDRESS).release()
