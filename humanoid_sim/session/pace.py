"""How the control loop keeps time: deadlines, what misses them, and how late the loop wakes up."""

from __future__ import annotations

from time import perf_counter, sleep

from humanoid_sim.session.histogram import DurationHistogram

__all__ = ["Pace"]

_SPIN = 0.0002
"""s before a deadline that are spent spinning: `sleep` wakes up to this much late on a common kernel."""


class Pace:
    """The deadlines of a loop with a fixed period; one that has passed is skipped, never caught up.

    Without real time there are none, and a tick that took longer than a period counts as an overrun instead.
    """

    def __init__(self, period: float, *, realtime: bool) -> None:
        """Start; the first tick sets the first deadline.

        Args:
            period: s
            realtime: whether there are deadlines at all.
        """
        self.period = period
        self.realtime = realtime
        self.overruns = 0
        """Ticks that missed their deadline."""
        self.skipped = 0
        """Deadlines that passed while a tick was still running."""
        self.jitter = DurationHistogram()
        """How long after its due time each tick began. Empty without real time."""
        self._deadline: float | None = None

    def begin(self) -> float:
        """Note that a tick begins; when, s."""
        now = perf_counter()
        if self._deadline is not None:
            self.jitter.add(max(now - self._deadline, 0.0))
        return now

    def written(self, start: float, now: float) -> bool:
        """Set the next deadline once the tick that began at `start` has written; whether it missed its own."""
        if not self.realtime:
            overrun = now - start > self.period
            self.overruns += overrun
            return overrun
        self._deadline = (start if self._deadline is None else self._deadline) + self.period
        return self._skip_missed(now)

    def wait(self) -> None:
        """Wait for the deadline, if there is one."""
        if self._deadline is None:
            return
        self._skip_missed(perf_counter())  # whatever came after the command has taken its time as well
        while (left := self._deadline - perf_counter()) > 0.0:
            if left > _SPIN:
                sleep(left - _SPIN)

    def restart(self) -> None:
        """Forget the deadline: what has just happened was no part of the loop."""
        self._deadline = None

    def _skip_missed(self, now: float) -> bool:
        """Move a deadline that has passed on to the next one that has not."""
        if self._deadline is None or now <= self._deadline:
            return False
        missed = int((now - self._deadline) / self.period) + 1
        self._deadline += missed * self.period
        self.overruns += 1
        self.skipped += missed
        return True
