import numpy as np
import pytest

from humanoid_sim.messages import Event, EventKind
from humanoid_sim.rendering.moments import Moments


def collected(make_tick, times, **options):
    moments = Moments(**options)
    for index, time in enumerate(times):
        moments.tick(make_tick(index, time, [index]))
    return moments


def test_a_second_of_ticks_gives_25_poses(make_tick):
    moments = collected(make_tick, [5.0 + index / 200 for index in range(201)])
    assert [moment.time for moment in moments.kept] == pytest.approx(np.arange(26) / 25)
    assert [int(moment.qpos[0]) for moment in moments.kept] == list(range(0, 201, 8))


def test_the_time_is_the_robots_without_long_pauses(make_tick):
    moments = collected(make_tick, [0.0, 0.05, 0.5, 0.4, np.nan, 0.4, 0.5, 1e9])
    # 0.5 s forward, a step back that counts as none, 0.1 s forward, and a jump that counts as one second.
    assert [moment.time for moment in moments.kept] == pytest.approx([0.0, 0.05, 0.5, 0.6, 1.6])


def test_a_long_run_is_kept_whole_at_a_lower_rate(make_tick):
    moments = collected(make_tick, [index / 25 for index in range(200)], most=40)
    times = [moment.time for moment in moments.kept]
    assert len(times) < 40
    assert (times[0], moments.rate) == (0.0, 25.0 / 8.0)
    assert times[-1] > 7.5
    assert np.diff(times) == pytest.approx(8.0 / 25.0)


def test_ticks_without_a_pose_are_left_out_and_the_first_fall_is_noted(make_tick):
    moments = Moments()
    moments.tick(make_tick(0, 0.0, None))
    for time in (3.0, 4.0):
        moments.event(Event(time, "fell", EventKind.FALL))
    assert moments.kept == []
    assert moments.fell == 3.0
