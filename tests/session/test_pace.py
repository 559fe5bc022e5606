from humanoid_sim.session import pace
from humanoid_sim.session.pace import Pace


def test_what_was_no_part_of_the_loop_misses_nothing(monkeypatch):
    """Time that a robot took to be made ready again is no missed deadline."""
    now = [50.0]

    def sleep(seconds):
        now[0] += seconds + 0.0002  # what is left would be spun away

    monkeypatch.setattr(pace, "perf_counter", lambda: now[0])
    monkeypatch.setattr(pace, "sleep", sleep)
    loop = Pace(0.02, realtime=True)
    loop.written(now[0], now[0])
    loop.wait()
    now[0] += 3.0
    loop.restart()
    assert not loop.written(now[0], now[0])
    loop.wait()
    assert 53.04 <= now[0] < 53.041
    assert (loop.overruns, loop.skipped) == (0, 0)
