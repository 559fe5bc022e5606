import pytest
from fakes import FakeRobot, FakeSink, session

from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.messages import EventKind


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
            raise RobotError("left: not known to be off")

    sink = FakeSink()
    summary = session(Unconfirmed(), duration=0.1, sinks=[sink]).run()
    assert summary.failures == ("robot: left: not known to be off",)
    assert sink.events[-1] == ("failed to close the robot: left: not known to be off", EventKind.FAILURE)
