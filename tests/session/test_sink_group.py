from __future__ import annotations

import contextlib
from typing import Any

import pytest
from fakes import HEADER, BrokenError, FakeSink

from humanoid_sim.errors import InputError
from humanoid_sim.session.sink_group import SinkGroup


def broken(*_: Any) -> None:
    raise BrokenError("on purpose")


def test_only_sinks_that_started_are_closed() -> None:
    log: list[str] = []
    first, second, third = (FakeSink(log, name=name) for name in "abc")
    second.start = lambda _: (_ for _ in ()).throw(InputError("b: cannot be written"))  # type: ignore[method-assign]
    group = SinkGroup([first, second, third], lambda: 0.0)
    with pytest.raises(InputError, match="b: cannot"), contextlib.ExitStack() as stack:
        group.start(HEADER, stack)
    assert log == ["start a", "close a"]


def test_a_sink_that_raises_is_left_out_and_the_others_hear_of_it() -> None:
    bad, good = FakeSink(), FakeSink()
    bad.tick = broken  # type: ignore[method-assign]
    group = SinkGroup([bad, good], lambda: 1.5)
    record: Any = object()
    group.tick(record)
    group.tick(record)
    group.event("later")
    assert good.records == [record, record]
    assert group.failures == ["FakeSink: BrokenError: on purpose"]
    assert good.events == [f"left out from here on: {group.failures[0]}", "later"]
    assert bad.events == []


def test_sinks_that_fail_at_the_news_of_a_failure_are_left_out_as_well() -> None:
    sinks = [FakeSink() for _ in range(3)]
    for sink in sinks:
        sink.event = broken  # type: ignore[method-assign]
    group = SinkGroup(sinks, lambda: 0.0)
    group.event("news")
    assert len(group.failures) == 3
    group.event("nobody is left to hear this")
    assert len(group.failures) == 3


def test_the_slowest_sink_decides_how_far_they_lag() -> None:
    quick, slow = FakeSink(), FakeSink()
    slow.waiting = [2001, 2000]
    group = SinkGroup([quick, slow], lambda: 0.0)
    assert [group.lags(2000), group.lags(2000)] == [True, False]
