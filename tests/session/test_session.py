import pytest
from fakes import (
    FakeRobot,
    FakeSink,
    session,
)

import humanoid_sim.session.session as loop
from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.messages import Intent
from humanoid_sim.session import pace

TO_STANDBY = {0: (Intent.DAMP,), 1: (Intent.LOAD_A,)}
TO_LOCOMOTION = {**TO_STANDBY, 6: (Intent.START_LOCOMOTION,)}


# Order.


# Ends.


def test_a_sink_that_cannot_start_keeps_the_robot_from_being_activated():
    class Unwritable(FakeSink):
        def start(self, header):
            raise InputError("run.mcap: cannot be written")

    log = []
    with pytest.raises(InputError, match=r"run\.mcap"):
        session(FakeRobot(log), sinks=[FakeSink(log, name="first"), Unwritable(log)]).run()
    assert log == ["start first", "close robot", "close first"]


def test_a_robot_that_does_not_confirm_its_end_makes_the_run_a_failure():
    class Unconfirmed(FakeRobot):
        def close(self):
            super().close()
            raise RobotError("left: not known to be off")

    sink = FakeSink()
    summary = session(Unconfirmed(), duration=0.1, sinks=[sink]).run()
    assert summary.failures == ("robot: left: not known to be off",)
    assert sink.events[-1] == "failed to close the robot: left: not known to be off"


# Time.


class FakeClock:
    """Time passes when somebody sleeps, and a little with every look at the clock."""

    def __init__(self, monkeypatch):
        self.now = 100.0
        self.slept = []
        for module in (loop, pace):
            monkeypatch.setattr(module, "perf_counter", self.look)
            monkeypatch.setattr(module, "sleep", self.sleep)

    def look(self):
        self.now += 1e-6
        return self.now

    def sleep(self, seconds):
        self.slept.append(seconds)
        self.now += seconds


def test_only_a_run_without_deadlines_waits_for_a_sink_that_lags(monkeypatch):
    clock = FakeClock(monkeypatch)
    sink = FakeSink()
    sink.waiting = [5000, 4000, 2001, 2000]
    session(FakeRobot(), duration=0.02, sinks=[sink]).run()
    assert clock.slept == [0.001] * 3
    sink = FakeSink()
    sink.waiting = [5000] * 100
    session(FakeRobot(), realtime=True, duration=0.02, sinks=[sink]).run()
    assert sink.questions == 0
