import threading

import pytest
from fakes import HEADER, FakeRobot, FakeSink, session
from waiting import until

from humanoid_sim.messages import Event, TickRecord
from humanoid_sim.recording import sink as sinks
from humanoid_sim.recording.sink import WorkerSink


def tick(number):
    return TickRecord(number, None, None, 0.0, False)


class Kept(WorkerSink):
    """Keeps what it is called with."""

    def __init__(self, fail_at=None, *, inline=False):
        super().__init__("kept", 0.001, inline=inline)
        self.calls, self._fail_at = [], fail_at

    def _note(self, call):
        self.calls.append(call)
        if call == self._fail_at:
            raise OSError(f"at {call}")

    def handle_tick(self, record):
        self._note(record.index)

    def handle_event(self, event):
        self._note(event.text)

    def handle_pause(self):
        self._note("pause")

    def handle_close(self):
        self._note("close")


@pytest.mark.parametrize("where", [1, "half", "pause"])
def test_one_that_raises_keeps_the_exception_and_takes_no_more(where):
    sink = Kept(fail_at=where)
    sink.start(HEADER)
    sink.tick(tick(0))
    sink.event(Event(0.5, "half"))
    sink.tick(tick(1))
    until(lambda: sink.error is not None)
    sink.tick(tick(2))
    sink.event(Event(1.0, "late"))
    sink.close()
    assert sink.error == f"at {where}"
    assert not {2, "late"} & set(sink.calls)


@pytest.mark.parametrize("where", [None, 1])
def test_one_that_works_inline_deals_with_everything_in_order_on_the_control_thread(where, monkeypatch):
    monkeypatch.setattr(sinks, "_BATCH", 3)
    sink = Kept(where, inline=True)
    sink.event(Event(0.0, "early"))
    sink.start(HEADER)
    for number in range(3):
        sink.tick(tick(number))
        sink.event(Event(0.0, f"after {number}"))
    assert sink.calls[:4] == ["early", 0, "after 0", 1]
    sink.close()
    assert sink.error == (None if where is None else "at 1")
    assert (2 in sink.calls) == ("close" in sink.calls) == (where is None)


class Stuck(Kept):
    """Does not come back from its first tick until it is let go: a console whose pipe nobody reads."""

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
    monkeypatch.setattr(Stuck, "stuck_after", 0.2)
    sink = Stuck()
    yield sink
    sink.let_go.set()
    sink._thread.join(60.0)


def test_a_stuck_worker_does_not_keep_a_run_from_ending(stuck):
    other = FakeSink()
    result = session(FakeRobot(), duration=60.0, sinks=[stuck, other]).run()
    assert len(other.records) == result.ticks > 2000
    assert stuck.error == "did not finish within 0.2 s"
    assert not {0, "close"} & set(stuck.calls)


def test_what_a_stuck_worker_keeps_is_bounded_and_the_rest_is_counted(stuck):
    stuck.start(HEADER)
    stuck.tick(tick(0))
    assert stuck.entered.wait(60.0)
    for number in range(sinks.QUEUE_LIMIT + 3):
        stuck.tick(tick(number))
    stuck.event(Event(1.0, "late"))
    assert stuck.lost == 4
    stuck.let_go.set()
    stuck.close()
    assert stuck.error is None
    assert [call for call in stuck.calls if call != "pause"] == [0, *range(sinks.QUEUE_LIMIT), "close"]
