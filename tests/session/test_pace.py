from __future__ import annotations

import pytest

from humanoid_sim.session import pace
from humanoid_sim.session.pace import Pace


class Clock:
    """Stands still unless somebody sleeps."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 50.0
        self.late = 0.0
        """s by which the next sleep ends too late."""
        monkeypatch.setattr(pace, "perf_counter", lambda: self.now)
        monkeypatch.setattr(pace, "sleep", self.sleep)

    def sleep(self, seconds: float) -> None:
        self.now += seconds + 0.0002 + self.late  # what is left would be spun away
        self.late = 0.0


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


def turn(loop: Pace, clock: Clock, seconds: float = 0.0) -> bool:
    start = loop.begin()
    clock.now += seconds
    overrun = loop.written(start, clock.now)
    loop.wait()
    return overrun


def test_ticks_begin_a_period_apart_whatever_they_take(clock: Clock) -> None:
    loop = Pace(0.02, realtime=True)
    for k in range(5):
        assert clock.now == pytest.approx(50.0 + 0.02 * k)
        assert not turn(loop, clock, 0.003 * k)
    assert (loop.overruns, loop.skipped) == (0, 0)
    assert loop.jitter.count == 4  # the first tick sets the first deadline
    assert loop.jitter.max == pytest.approx(0.0, abs=1e-9)


def test_waking_up_late_is_jitter_and_moves_no_deadline(clock: Clock) -> None:
    loop = Pace(0.02, realtime=True)
    clock.late = 0.004
    turn(loop, clock)
    assert clock.now == pytest.approx(50.024)
    turn(loop, clock)
    assert clock.now == pytest.approx(50.04)
    turn(loop, clock)
    assert loop.jitter.count == 2
    assert loop.jitter.max == pytest.approx(0.004)
    assert loop.overruns == 0


def test_a_missed_deadline_is_skipped(clock: Clock) -> None:
    loop = Pace(0.02, realtime=True)
    assert turn(loop, clock, 0.05)
    assert clock.now == pytest.approx(50.06)
    assert (loop.overruns, loop.skipped) == (1, 2)


def test_what_was_no_part_of_the_loop_misses_nothing(clock: Clock) -> None:
    loop = Pace(0.02, realtime=True)
    turn(loop, clock)
    clock.now += 3.0
    loop.restart()
    assert not turn(loop, clock)
    assert clock.now == pytest.approx(53.04)
    assert (loop.overruns, loop.skipped, loop.jitter.count) == (0, 0, 0)


def test_without_real_time_nothing_is_waited_for(clock: Clock) -> None:
    loop = Pace(0.02, realtime=False)
    assert [turn(loop, clock, seconds) for seconds in (0.01, 0.03)] == [False, True]
    assert clock.now == pytest.approx(50.04)
    assert (loop.overruns, loop.skipped, loop.jitter.count) == (1, 0, 0)
