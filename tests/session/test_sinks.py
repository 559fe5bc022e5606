import threading

import pytest
import rig
from fakes import HEADER, BrokenError, FakeRobot, FakeSink, session
from waiting import until

from humanoid_sim.messages import Event
from humanoid_sim.session import sinks
from humanoid_sim.session.sinks import WorkerSink


class Kept(WorkerSink):
    """Writes down what it is called with, on which thread."""

    def __init__(self, fail_at="", period=0.001):
        super().__init__("kept", period)
        self.calls = []
        self.threads = set()
        self._fail_at = fail_at

    def _note(self, what):
        self.calls.append(what)
        if str(what) == self._fail_at:
            raise BrokenError(f"at {what}")

    def handle_tick(self, record):
        self.threads.add(threading.current_thread().name)
        self._note(record.index)

    def handle_event(self, event):
        self._note((event.time, event.text))

    def handle_pause(self):
        if self._fail_at == "pause":
            raise BrokenError("at pause")

    def handle_close(self):
        self._note("close")


def records(count):
    sink = FakeSink()
    session(FakeRobot(), duration=count * rig.PERIOD, sinks=[sink]).run()
    return sink.records[:count]


@pytest.mark.parametrize("where", ["1", "(0.5, 'half')", "pause"])
def test_one_that_raises_keeps_the_exception_and_takes_no_more(where):
    sink = Kept(fail_at=where)
    sink.start(HEADER)
    ticks = records(3)
    sink.tick(ticks[0])
    sink.event(Event(0.5, "half"))
    sink.tick(ticks[1])
    until(lambda: sink.error is not None)
    for record in ticks:
        sink.tick(record)
    sink.event(Event(1.0, "late"))
    assert sink.backlog == 0
    sink.close()
    assert str(sink.error) == f"at {where}"
    assert (1.0, "late") not in sink.calls
    assert 2 not in sink.calls


class Stuck(Kept):
    """Does not come back from its first tick until it is let go: a console whose pipe nobody reads."""

    backlog = 0

    def __init__(self):
        super().__init__()
        self.entered, self.let_go = threading.Event(), threading.Event()

    def handle_tick(self, record):
        self.entered.set()
        self.let_go.wait(30.0)
        super().handle_tick(record)


@pytest.fixture
def stuck(monkeypatch):
    """A sink that is stuck from its first tick on; let go in the end."""
    monkeypatch.setattr(sinks, "_STUCK_AFTER", 0.2)
    sink = Stuck()
    yield sink
    sink.let_go.set()
    sink._thread.join(60.0)


def test_a_stuck_worker_does_not_keep_a_run_from_ending(stuck):
    other = FakeSink()
    result = session(FakeRobot(), duration=60.0, sinks=[stuck, other]).run()  # longer than the backlog of a run
    assert len(other.records) == result.ticks > 2000
    assert isinstance(stuck.error, TimeoutError)
    assert str(stuck.error) == "did not finish within 0.2 s"
    assert stuck.backlog == 0
    assert stuck.calls == []


def test_what_a_stuck_worker_keeps_is_bounded_and_the_rest_is_counted(stuck):
    stuck.start(HEADER)
    tick = records(1)[0]
    stuck.tick(tick)
    assert stuck.entered.wait(60.0)
    for _ in range(sinks.QUEUE_LIMIT + 3):
        stuck.tick(tick)
    stuck.event(Event(1.0, "late"))
    assert (len(stuck._queue), stuck.lost) == (sinks.QUEUE_LIMIT, 4)
    stuck.let_go.set()
    until(lambda: len(stuck.calls) == 1 + sinks.QUEUE_LIMIT)
    stuck.close()
    assert stuck.error is None
    assert stuck.calls[-1] == "close"
