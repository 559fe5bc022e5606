"""Tells a machine that stands still from a loop that is slow: `stall_watch.py CPU SECONDS`.

A process of its own on one CPU, before everything else under SCHED_FIFO where that is permitted. It sleeps for 0.5 ms
again and again, and prints when it was late by another 0.25 ms: from when to when the CPU stood still, s,
CLOCK_MONOTONIC. Nothing that runs on this machine can keep it waiting for so long, but the kernel, or the host of a
virtual machine.
"""

import contextlib
import gc
import os
import sys
import time

_PRIORITY = 80
_NAP, _LATE = 0.0005, 0.00025
"""s"""

if __name__ == "__main__":
    cpu, seconds = int(sys.argv[1]), float(sys.argv[2])
    os.sched_setaffinity(0, {cpu})
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    gc.disable()
    end = time.perf_counter() + seconds
    while (before := time.perf_counter()) < end:
        time.sleep(_NAP)
        after = time.perf_counter()
        if after - before > _NAP + _LATE:
            print(before + _NAP, after, flush=True)
