import threading

import pytest
from fakes import FakeRobot, FakeSink, session

from humanoid_sim.recording.sink import WorkerSink


class Stuck(WorkerSink):
    """Does not come back from its first tick until it is let go: a console whose pipe nobody reads."""

    stuck_after = 0.1

    def __init__(self):
        super().__init__("stuck", 0.001)
        self.let_go, self.calls = threading.Event(), []

    def handle_tick(self, record):
        self.let_go.wait(60.0)
        self.calls.append(record.index)

    def handle_close(self):
        self.calls.append("close")


class Failing(WorkerSink):
    """On the control thread, as in a run that does not keep real time."""

    def __init__(self):
        super().__init__("failing", inline=True)
        self.calls = []

    def handle_tick(self, record):
        self.calls.append(record.index)
        if record.index == 2:
            raise OSError("the disk is full")


def test_one_that_fails_is_not_called_again_and_the_run_goes_on():
    sink, other = Failing(), FakeSink()
    session(FakeRobot(), duration=4.0, sinks=[sink, other]).run()
    assert sink.error == "the disk is full"
    assert sink.calls == [0, 1, 2]
    assert len(other.records) >= 200


@pytest.fixture
def stuck():
    sink = Stuck()
    yield sink
    sink.let_go.set()


def test_a_stuck_worker_does_not_keep_a_run_from_ending(stuck):
    other = FakeSink()
    result = session(FakeRobot(), duration=60.0, sinks=[stuck, other]).run()
    assert len(other.records) == result.ticks > 2000
    assert stuck.error == "did not finish within 0.1 s"
    assert stuck.calls == []
