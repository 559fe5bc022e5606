"""A mock Sito motor by itself: what it does with a host's frames, and what it sends."""

import math

import pytest

from humanoid_sim.hardware.mock.sito_motor import SitoMotor
from humanoid_sim.hardware.sito import protocol
from humanoid_sim.robots.motors import MOTORS

MODEL = MOTORS["TA40-50"]
ENABLE = protocol.SelectMode(22, protocol.Mode.MIT, (20, 20, 0))


class Bench:
    def __init__(self, shaft=0.25):
        self.motor = SitoMotor(MODEL, 22)
        self.motor.sensed.shaft = shaft
        self.motor.power_on()
        self.time = 0.0

    def tell(self, *messages):
        for message in messages:
            assert self.motor.receive(protocol.encode(message, MODEL), self.time) == (), "nothing is answered"

    def wait(self, duration):
        found = []
        for _ in range(round(duration / 0.001)):
            self.time += 0.001
            found += [(round(self.time, 4), frame) for frame in self.motor.advance(self.time)]
        return found


def test_feedback_comes_by_its_own_clock_in_two_frames_while_it_is_enabled():
    bench = Bench()
    assert bench.wait(0.1) == []
    bench.tell(ENABLE)
    sensed = bench.motor.sensed
    sensed.shaft, sensed.velocity, sensed.torque = 0.5, 1.0, 2.0
    found = bench.wait(0.1)
    assert [time for time, _ in found] == [0.12, 0.12, 0.14, 0.14, 0.16, 0.16, 0.18, 0.18, 0.2, 0.2]
    first, second = (protocol.decode(frame, MODEL) for _, frame in found[:2])
    assert (first.velocity, first.effort, second.position) == pytest.approx((1.0, 2.0, 0.5), abs=0.01)
    bench.tell(protocol.Reset(22))
    assert bench.wait(0.1) == []
    bench.tell(ENABLE)
    sensed.velocity = -12.0
    assert protocol.decode(bench.wait(0.02)[0][1], MODEL).velocity == pytest.approx(-math.pi, abs=1e-3), "cut"


def test_gains_hold_until_others_come_and_outlive_a_reset():
    bench = Bench()
    bench.tell(protocol.Gains(22, 20.0, 1.0), protocol.Command(22, 0.5, 0.0, 0.25))
    assert bench.motor.drive().stiffness == 0.0, "disabled"
    bench.tell(ENABLE)
    drive = bench.motor.drive()
    assert (drive.stiffness, drive.damping, drive.position) == pytest.approx((20.0, 1.0, 0.5), abs=1e-4)
    bench.tell(protocol.Reset(22), ENABLE)
    bench.wait(10.0)
    assert bench.motor.drive().stiffness == pytest.approx(20.0), "nothing stops it, its host silent"
    bench.motor.power_on()
    bench.tell(ENABLE)
    assert bench.motor.drive()[:5] == (0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(("sensor", "value"), [("temperature", 150.0), ("voltage", 11.0), ("overcurrent", True)])
def test_one_that_protects_itself_falls_silent(sensor, value):
    bench = Bench()
    bench.tell(ENABLE, protocol.Gains(22, 20.0, 1.0))
    setattr(bench.motor.sensed, sensor, value)
    assert bench.wait(0.1) == []
    bench.tell(ENABLE)
    assert not bench.motor.is_running


@pytest.mark.parametrize(("shaft", "position"), [(0.25, 0.25), (7.0, 7.0 - 2.0 * math.pi), (-4.0, 2.0 * math.pi - 4.0)])
def test_the_turn_is_lost_at_power_on(shaft, position):
    bench = Bench(shaft)
    bench.tell(ENABLE)
    assert protocol.decode(bench.wait(0.02)[1][1], MODEL).position == pytest.approx(position, abs=1e-4)
