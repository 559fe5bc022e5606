"""How old a sample is that came over DDS."""

from __future__ import annotations

from humanoid_sim.frontends.dds.commands import ArrivalClock

MS = 1_000_000
HOUR = 3_600_000 * MS
ONE, OTHER = 1, 2


def test_a_sample_came_after_the_look_before() -> None:
    clock = ArrivalClock(1000 * MS)
    clock.look(1005 * MS)
    assert clock.stamp(ONE, 7) == 1000 * MS
    clock.look(1006 * MS)
    assert clock.stamp(ONE, 7 + HOUR) == 1005 * MS, "the writer's clock shows what it likes"


def test_what_waited_while_the_process_stood_still_is_old_and_what_is_written_later_is_young() -> None:
    clock = ArrivalClock(1000 * MS)
    clock.look(1005 * MS)
    written = -HOUR  # by a clock that is far behind
    assert clock.stamp(ONE, written) == 1000 * MS
    clock.look(2005 * MS)  # a second later
    assert clock.stamp(ONE, written + 5 * MS) == 1005 * MS
    assert clock.stamp(ONE, written + 900 * MS) == 1900 * MS
    assert clock.stamp(OTHER, 0) == 1005 * MS, "nobody knows how old this is"
    clock.look(2010 * MS)  # more from the sockets
    assert clock.stamp(ONE, written + 300 * MS) == 1300 * MS
    assert clock.stamp(ONE, written + 1008 * MS) == 2008 * MS
    assert clock.stamp(OTHER, 5 * MS) == 1005 * MS
    for now in range(2015, 2115, 5):
        clock.look(now * MS)
    assert clock.stamp(OTHER, 10 * MS) == 2105 * MS, "all is as usual again"


def test_a_clock_that_jumps_meanwhile_makes_nothing_younger_than_now_or_older_than_before() -> None:
    for jump in (-HOUR, HOUR):
        clock = ArrivalClock(0)
        clock.look(5 * MS)
        clock.stamp(ONE, 0)
        clock.look(500 * MS)
        assert clock.stamp(ONE, jump) == (5 * MS if jump < 0 else 500 * MS)


def test_standing_still_twice_counts_from_the_first_time_until_all_has_settled() -> None:
    clock = ArrivalClock(0)
    clock.look(5 * MS)
    clock.stamp(ONE, 0)
    clock.look(500 * MS)
    clock.look(590 * MS)
    assert clock.stamp(OTHER, 0) == 5 * MS
    clock.look(595 * MS)
    assert clock.stamp(ONE, 100 * MS) == 100 * MS
