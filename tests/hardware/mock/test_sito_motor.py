"""A mock Sito motor by itself: what it does with a host's frames, and what it sends."""

import math

import pytest

from humanoid_sim.hardware.mock.sito_motor import SitoMotor
from humanoid_sim.hardware.sito.protocol import Command, Enable, Gains, Reset, decode, encode
from humanoid_sim.robots.motors import MOTORS

MODEL = MOTORS["TA40-50"]


class Bench:
    def __init__(self, shaft=0.25):
        self.motor = SitoMotor(MODEL, 22)
        self.motor.sensed.shaft = shaft
        self.motor.power_on()
        self.time = 0.0

    def send(self, *messages):
        for message in messages:
            assert self.motor.receive(encode(message, MODEL), self.time) == (), "nothing is answered"

    def wait(self, duration):
        found = []
        for _ in range(round(duration / 0.001)):
            self.time += 0.001
            found += [(round(self.time, 4), decode(frame, MODEL)) for frame in self.motor.advance(self.time)]
        return found


def test_feedback_comes_by_its_own_clock_in_two_frames_while_it_is_enabled():
    bench = Bench()
    assert bench.wait(0.1) == []
    bench.send(Enable(22, 20))
    sensed = bench.motor.sensed
    sensed.shaft, sensed.velocity, sensed.torque = 0.5, -12.0, 2.0
    found = bench.wait(0.1)
    assert [time for time, _ in found] == [0.12, 0.12, 0.14, 0.14, 0.16, 0.16, 0.18, 0.18, 0.2, 0.2]
    (_, first), (_, second) = found[:2]
    assert (first.velocity, first.effort, second.position) == pytest.approx((-math.pi, 2.0, 0.5), abs=0.01)
    bench.send(Reset(22))
    assert bench.wait(0.1) == []


def test_gains_hold_until_others_come_and_outlive_a_reset():
    bench = Bench()
    bench.send(Gains(22, 20.0, 1.0), Command(22, 0.5, 0.0, 0.25))
    assert bench.motor.drive().stiffness == 0.0, "disabled"
    bench.send(Enable(22, 20), Reset(22), Enable(22, 20))
    bench.wait(10.0)
    drive = bench.motor.drive()
    assert (drive.stiffness, drive.damping, drive.position) == pytest.approx((20.0, 1.0, 0.5), abs=1e-4)
    bench.motor.power_on()
    bench.send(Enable(22, 20))
    assert bench.motor.drive()[:5] == (0.0, 0.0, 0.0, 0.0, 0.0)
