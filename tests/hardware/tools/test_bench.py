import time

import pytest

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.bus.address import parse_address
from humanoid_sim.hardware.bus.open_channels import ChannelLock
from humanoid_sim.hardware.emulation.faults import Fault
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.robstride.requests import Unreadable
from humanoid_sim.hardware.tools.bench import SilentMotorError, open_bench, read_device_id, read_value, some_motors

_ADDRESS = parse_address("virtual:bench-client")


def test_a_lost_question_is_asked_again(bench, monkeypatch):
    sent = []
    send = bench.send

    def send_all_but_the_first(commands):
        sent.append(commands)
        if len(sent) > 1:
            send(commands)

    monkeypatch.setattr(bench, "send", send_all_but_the_first)
    assert len(read_device_id(bench).uid) == 8
    assert sent[1] == sent[0]


def test_a_late_answer_is_not_the_next_questions(bench, motors, inject):
    inject(motors, Fault("delayed", ("left_wrist_yaw",), value=0.06))
    assert isinstance(bench.read({0: PARAMETERS["VBUS"]}, (0.02,))[0], Unreadable)
    assert read_value(bench, PARAMETERS["canTimeout"]) == 0


def test_polling_takes_late_answers_the_next_time(bench, motors, inject):
    inject(motors, Fault("delayed", ("left_wrist_yaw",), value=0.06))
    begin = time.monotonic()
    polled = {}
    while not polled and time.monotonic() < begin + 5.0:
        polled = bench.poll_values(PARAMETERS["VBUS"], [0], 0.01)
    assert polled == {0: 48.0}


def test_motors_that_are_silent_are_left_out(bench, motors, inject):
    inject(motors, Fault("silent", ("left_wrist_yaw",)))
    bench.expect(some_motors([(0, 14), (0, 15), (0, 16)], bench.sources))
    assert bench.poll_values(PARAMETERS["VBUS"], range(3), 0.1) == {0: 48.0, 2: 48.0}
    found = bench.read(dict.fromkeys(range(3), PARAMETERS["VBUS"]), (0.1,))
    assert found == {0: 48.0, 1: Unreadable("no answer", is_silent=True), 2: 48.0}


def test_a_bus_that_is_down_is_an_error_and_says_why(bench, motors, inject):
    inject(motors, Fault("bus_off"))
    for _ in range(2):
        with pytest.raises((RobotError, SilentMotorError), match=r"bus-off|Network is down"):
            read_device_id(bench)


def test_silence_says_what_the_channel_knows_of_it(bench, motors, inject):
    inject(motors, Fault("enobufs"))
    with pytest.raises(
        SilentMotorError, match=r"motor 15 does not answer on virtual:bench-client \(outgoing queue is full"
    ):
        read_device_id(bench)


def test_a_bench_that_cannot_open_its_channel_gives_it_back():
    def refuse(_):
        raise RobotError("cannot be opened")

    group = some_motors([(0, 15)], [str(_ADDRESS)])
    with pytest.raises(RobotError, match="cannot be opened"), open_bench([_ADDRESS], 0xFD, group, open_channel=refuse):
        pass
    ChannelLock(_ADDRESS).release()
