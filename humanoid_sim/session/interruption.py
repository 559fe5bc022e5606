"""A loop that stood still: the process was stopped, or its terminal tried to suspend it.

Whatever drove the robot before a standstill must not drive it after: the motors have stopped by themselves meanwhile,
the arms have sunk, and nobody knows what the operator did about it.
"""

from __future__ import annotations

import time as system_time
from collections import deque
from collections.abc import Callable, Sequence

from humanoid_sim.messages import Intent, TickOutput
from humanoid_sim.session.sources import IntentSource

_LATE = 1.5
"""Control periods after which a loop that was told to continue has missed a tick."""


def running_time() -> float:
    """Since the computer started, s, including the time for which it was suspended."""
    return system_time.clock_gettime(getattr(system_time, "CLOCK_BOOTTIME", system_time.CLOCK_MONOTONIC))


class Interruption(IntentSource):
    """Asks for DAMP in the tick that follows a standstill, and when a terminal wants to suspend the process."""

    def __init__(self, period: float, longest: float, clock: Callable[[], float] = running_time) -> None:
        """Begin at the first tick.

        Args:
            period: s, of the control loop.
            longest: s between two signs of life of the loop; beyond that it stood still.
            clock: s; goes on while the process is stopped.
        """
        self._period = period
        self._longest = longest
        self._clock = clock
        self._last: float | None = None
        self._continued = False
        self._damps = False
        self._news: deque[str] = deque()

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """DAMP, once, after a standstill or a refused suspension."""
        self.beat()
        damps, self._damps = self._damps, False
        return (Intent.DAMP,) if damps else ()

    def beat(self) -> bool:
        """Return a sign of life of the loop; whether it has stood still since the last one."""
        now = self._clock()
        last, self._last = self._last, now
        limit = min(_LATE * self._period, self._longest) if self._continued else self._longest
        self._continued = False
        if last is None or now - last <= limit:
            return False
        self._damps = True
        self._news.append(
            f"the process stood still for {now - last:.2f} s: DAMPING; motors whose CAN timeout is shorter have "
            "stopped, reactivate enables them again"
        )
        return True

    def news(self) -> str:
        """Return what to tell the operator since the last call; empty for nothing."""
        return self._news.popleft() if self._news else ""

    def refuse_suspension(self) -> None:
        """Refuse to suspend the process, as was asked. May be called from a signal handler."""
        self._damps = True
        self._news.append("SIGTSTP (Ctrl-Z): a process that holds motors is not suspended; DAMPING instead")

    def note_continued(self) -> None:
        """Note that the process continues: one missed tick is a standstill then."""
        self._continued = True

    def restart(self) -> None:
        """Start anew: what has just happened was not part of the loop."""
        self._last = None
