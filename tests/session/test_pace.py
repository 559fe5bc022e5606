"""Time that a robot took to be made ready again is no missed deadline."""

import pytest

from humanoid_sim.session import pace
from humanoid_sim.session.pace import Pace


class Clock:
    """Stands still unless somebody sleeps."""

    def __init__(self, monkeypatch):
        self.now = 50.0
        self.late = 0.0
        """s by which the next sleep ends too late."""
        monkeypatch.setattr(pace, "perf_counter", lambda: self.now)
        monkeypatch.setattr(pace, "sleep", self.sleep)

    def sleep(self, seconds):
        self.now += seconds + 0.0002 + self.late  # what is left would be spun away
        self.late = 0.0


@pytest.fixture
def clock(monkeypatch):
    return Clock(monkeypatch)


def turn(loop, clock):
    overrun = loop.written(clock.now, clock.now)
    loop.wait()
    return overrun


def test_what_was_no_part_of_the_loop_misses_nothing(clock):
    loop = Pace(0.02, realtime=True)
    turn(loop, clock)
    clock.now += 3.0
    loop.restart()
    assert not turn(loop, clock)
    assert clock.now == pytest.approx(53.04)
    assert (loop.overruns, loop.skipped) == (0, 0)
