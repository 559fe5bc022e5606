"""Measures that keep a control loop punctual on a common Linux: each is taken where it is permitted, and reported.

- The garbage collector never does a full collection, which takes longer than a tick once MuJoCo is loaded.
- Threads hand over every 0.5 ms, so that one that computes does not keep the control thread waiting for 5 ms.
- The control thread, and those that it starts meanwhile (the buses'), run under SCHED_FIFO; other threads behind it.
"""

from __future__ import annotations

import contextlib
import gc
import os
import sys
from collections.abc import Iterator

_PRIORITY = 50  # 1 to 99: before everything ordinary, behind the kernel's own threads for interrupts and timers
_SWITCH_INTERVAL = 0.0005  # s
_MIDDLE = 5  # collections of the youngest objects between two of the middle generation (0.4 ms); 10 by default
_NEVER = 1 << 30  # collections of the middle generation between two full ones


@contextlib.contextmanager
def real_time(ahead: int = 0) -> Iterator[tuple[str, ...]]:
    """Take the measures on the calling thread while the context lasts; yields one line on each of them.

    `ahead` is the priority before a control loop's, of a process that must run when a loop does not let others run.
    """
    with contextlib.ExitStack() as undo:
        gc.collect()
        gc.freeze()
        undo.callback(gc.unfreeze)
        undo.callback(gc.set_threshold, *gc.get_threshold())
        gc.set_threshold(gc.get_threshold()[0], _MIDDLE, _NEVER)
        undo.callback(sys.setswitchinterval, sys.getswitchinterval())
        sys.setswitchinterval(_SWITCH_INTERVAL)
        switching = f"threads switch every {1e3 * _SWITCH_INTERVAL:g} ms"
        yield "garbage collector frozen", switching, _fifo(undo, _PRIORITY + ahead)


@contextlib.contextmanager
def punctual_threads(behind: int) -> Iterator[str]:
    """Threads that the calling one starts meanwhile run under SCHED_FIFO, `behind` the loop; yields a line on it."""
    with contextlib.ExitStack() as undo:
        yield _fifo(undo, _PRIORITY - behind)


def _fifo(undo: contextlib.ExitStack, priority: int) -> str:
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        return f"SCHED_FIFO refused ({error.strerror}): give this user an rtprio limit of {_PRIORITY} or more"
    undo.callback(os.sched_setscheduler, 0, *before)
    return f"SCHED_FIFO, priority {priority}"
