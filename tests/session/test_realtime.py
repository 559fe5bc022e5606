import gc
import os
import sys

import pytest

from humanoid_sim.session.realtime import real_time


def test_every_measure_says_what_it_got_and_is_taken_back():
    interval, policy, thresholds = sys.getswitchinterval(), os.sched_getscheduler(0), gc.get_threshold()
    with real_time() as lines:
        collector, switches, fifo = lines
        assert collector == "garbage collector frozen"
        assert gc.get_freeze_count() > 1000
        assert gc.get_threshold()[2] > 1_000_000, "no full collection"
        assert switches == "threads switch every 0.5 ms"
        assert sys.getswitchinterval() == pytest.approx(0.0005)
        assert (os.sched_getscheduler(0) == os.SCHED_FIFO) == (fifo == "SCHED_FIFO, priority 50")
    assert gc.get_freeze_count() == 0
    assert gc.get_threshold() == thresholds
    assert sys.getswitchinterval() == interval
    assert os.sched_getscheduler(0) == policy


def test_what_is_not_permitted_is_said_with_what_would_permit_it(monkeypatch):
    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with real_time() as lines:
        assert lines[2] == "SCHED_FIFO refused (Operation not permitted): give this user an rtprio limit of 50 or more"
