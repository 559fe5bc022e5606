import pytest

from humanoid_sim.session import pace
from humanoid_sim.session.pace import Pace


class Clock:
    """Stands still unless somebody sleeps."""

    now = 50.0

    def sleep(self, seconds):
        self.now += seconds + 0.0002  # what is left would be spun away


def test_ticks_begin_a_period_apart_and_what_was_no_part_of_the_loop_misses_nothing(monkeypatch):
    clock, loop = Clock(), Pace(0.02, realtime=True)
    monkeypatch.setattr(pace, "perf_counter", lambda: clock.now)
    monkeypatch.setattr(pace, "sleep", clock.sleep)

    def turn(seconds):
        start = loop.begin()
        clock.now += seconds
        assert not loop.written(start, clock.now)
        loop.wait()

    for k in range(5):
        assert clock.now == pytest.approx(50.0 + 0.02 * k)
        turn(0.003 * k)
    assert len(loop.lateness) == 4  # the first tick sets the first deadline
    clock.now += 3.0
    loop.restart()
    turn(0.0)
    assert clock.now == pytest.approx(53.12)
    assert (loop.overruns, loop.skipped, len(loop.lateness)) == (0, 0, 4)
    assert max(loop.lateness) == pytest.approx(0.0, abs=1e-9)
