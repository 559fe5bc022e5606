import gc
import os
import resource
import sys
from pathlib import Path

import pytest

from humanoid_sim.session import realtime
from humanoid_sim.session.realtime import real_time


def locked_kilobytes():
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return int(next(line for line in lines if line.startswith("VmLck:")).split()[1])


def test_every_measure_says_what_it_got_and_is_taken_back():
    interval, policy, thresholds = sys.getswitchinterval(), os.sched_getscheduler(0), gc.get_threshold()
    with real_time() as lines:
        collector, switches, fifo, memory = lines
        assert collector == "garbage collector frozen"
        assert gc.get_freeze_count() > 1000
        assert gc.get_threshold()[2] > 1_000_000, "no full collection"
        assert switches == "threads switch every 0.5 ms"
        assert sys.getswitchinterval() == pytest.approx(0.0005)
        assert (os.sched_getscheduler(0) == os.SCHED_FIFO) == (fifo == "SCHED_FIFO, priority 50")
        assert (locked_kilobytes() > 0) == (memory == "memory locked")
    assert gc.get_freeze_count() == 0
    assert gc.get_threshold() == thresholds
    assert sys.getswitchinterval() == interval
    assert os.sched_getscheduler(0) == policy
    assert locked_kilobytes() == 0


def test_what_is_not_permitted_is_said_with_what_would_permit_it(monkeypatch):
    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(realtime, "_may_lock_memory", lambda: False)
    monkeypatch.setattr(resource, "getrlimit", lambda _: (1 << 40, 1 << 40))  # what does not fit fails in mid-run
    with real_time() as lines:
        assert lines[2] == "SCHED_FIFO refused (Operation not permitted): give this user an rtprio limit of 50 or more"
        assert lines[3] == "memory not locked: give this user an unlimited memlock limit"
