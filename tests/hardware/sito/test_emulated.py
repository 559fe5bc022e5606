"""An emulated Sito motor by itself: what it does with a host's frames, and what it sends of itself."""

import math

import pytest

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.emulated_motor import Sensed
from humanoid_sim.hardware.sito import codec
from humanoid_sim.hardware.sito.emulated import SitoFirmware
from humanoid_sim.robots.motors import MOTORS

MODEL = MOTORS["TA40-50"]
ENABLE = codec.SelectMode(22, codec.Mode.MIT, (20, 20, 0))


class Bench:
    def __init__(self, *, is_deaf=False, shaft=0.25):
        self.firmware = SitoFirmware(MODEL, 22, is_deaf=is_deaf)
        self.sensed = Sensed(shaft)
        self.time = 0.0
        self.state = self.firmware.power_on(None, self.sensed)

    def tell(self, *messages):
        for message in messages:
            reaction = self.firmware.receive(self.state, codec.encode(message, MODEL), self.sensed, self.time)
            assert reaction.frames == (), "nothing is answered"
            self.state = reaction.state

    def wait(self, duration):
        heard = []
        for _ in range(round(duration / 0.001)):
            self.time += 0.001
            reaction = self.firmware.advance(self.state, self.sensed, self.time)
            self.state = reaction.state
            heard += [(round(self.time, 4), frame) for frame in reaction.frames]
        return heard


def test_feedback_comes_by_its_own_clock_in_two_frames_while_it_is_enabled():
    bench = Bench()
    assert bench.wait(0.1) == []
    bench.tell(ENABLE)
    bench.sensed = Sensed(0.5, 1.0, 2.0)
    heard = bench.wait(0.1)
    assert [time for time, _ in heard] == [0.12, 0.12, 0.14, 0.14, 0.16, 0.16, 0.18, 0.18, 0.2, 0.2]
    first, second = (codec.decode(frame, MODEL) for _, frame in heard[:2])
    assert isinstance(first, codec.Feedback)
    assert isinstance(second, codec.PositionFeedback)
    assert (first.velocity, first.effort, second.position) == pytest.approx((1.0, 2.0, 0.5), abs=0.01)
    bench.tell(codec.Reset(22))
    assert bench.wait(0.1) == []
    bench.tell(ENABLE)
    bench.sensed = Sensed(0.0, -12.0)
    feedback = codec.decode(bench.wait(0.02)[0][1], MODEL)
    assert isinstance(feedback, codec.Feedback)
    assert feedback.velocity == pytest.approx(-math.pi, abs=1e-3), "cut at its integer"


def test_gains_hold_until_others_come_and_outlive_a_reset():
    bench = Bench()
    bench.tell(codec.Gains(22, 20.0, 1.0), codec.Command(22, 0.5, 0.0, 0.25))
    assert bench.firmware.drive(bench.state).stiffness == 0.0, "disabled"
    bench.tell(ENABLE)
    drive = bench.firmware.drive(bench.state)
    assert (drive.stiffness, drive.damping, drive.position) == pytest.approx((20.0, 1.0, 0.5), abs=1e-4)
    assert drive.effort == pytest.approx(0.25, abs=0.005)
    bench.tell(codec.Reset(22), ENABLE)
    bench.wait(10.0)
    assert bench.firmware.drive(bench.state).stiffness == pytest.approx(20.0), "nothing stops it, its host silent"
    bench.state = bench.firmware.power_on(bench.state, bench.sensed)
    bench.tell(ENABLE)
    assert bench.firmware.drive(bench.state)[:5] == (0.0, 0.0, 0.0, 0.0, 0.0)


def test_one_that_is_deaf_until_it_is_enabled_starts_as_its_last_host_left_it():
    bench = Bench(is_deaf=True)
    bench.tell(ENABLE, codec.Gains(22, 20.0, 1.0), codec.Reset(22), codec.Gains(22, 0.0, 0.0), ENABLE)
    assert bench.firmware.drive(bench.state).stiffness == pytest.approx(20.0)
    bench.tell(codec.Gains(22, 0.0, 0.0))
    assert bench.firmware.drive(bench.state).stiffness == 0.0


@pytest.mark.parametrize("trouble", [{"temperature": 150.0}, {"voltage": 11.0}, {"encoder_fault": True}])
def test_one_that_protects_itself_falls_silent_without_a_word(trouble):
    bench = Bench()
    bench.tell(ENABLE, codec.Gains(22, 20.0, 1.0))
    bench.sensed = Sensed(0.25)._replace(**trouble)
    assert bench.wait(0.1) == []
    assert not bench.state.is_running
    bench.tell(ENABLE)
    assert not bench.state.is_running


@pytest.mark.parametrize(("shaft", "position"), [(0.25, 0.25), (7.0, 7.0 - 2.0 * math.pi), (-4.0, 2.0 * math.pi - 4.0)])
def test_the_turn_is_lost_at_power_on(shaft, position):
    bench = Bench(shaft=shaft)
    bench.tell(ENABLE)
    feedback = codec.decode(bench.wait(0.02)[1][1], MODEL)
    assert isinstance(feedback, codec.PositionFeedback)
    assert feedback.position == pytest.approx(position, abs=1e-4)


def test_frames_of_others_are_not_for_it():
    firmware, state = Bench().firmware, Bench().state
    assert firmware.is_for(state, codec.encode(codec.Reset(22), MODEL))
    assert not firmware.is_for(state, codec.encode(codec.Reset(23), MODEL))
    assert not firmware.is_for(state, Frame(0x0300FD16, bytes(8)))  # enable, to a Robstride 22
