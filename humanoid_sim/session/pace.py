"""Timing of a control loop: its settings, its deadlines and what misses them."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter, sleep

_SPIN = 0.0002  # s before a deadline that are spent spinning: `sleep` wakes up to this much late on a common kernel


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """How a loop keeps time, and how it ends."""

    control_period: float  # s
    realtime: bool = True  # a simulated robot may run as fast as it can instead
    simulated: bool = True
    """Writing advances physics, whose time is not the tick's own; False: the loop takes `real_time`'s measures."""
    duration: float | None = None  # s on the robot's clock; None: until a source says so, or QUIT


@dataclass(slots=True)
class Pace:
    """Deadlines of a loop with a fixed period; one that has passed is skipped and counted, never caught up.

    Without real time there are none, and a tick that took longer than a period counts as an overrun instead.
    """

    period: float  # s
    realtime: bool
    overruns: int = 0  # ticks that missed their deadline
    skipped: int = 0  # deadlines that passed while a tick was still running
    _deadline: float | None = None

    def written(self, start: float, now: float) -> bool:
        """Set the next deadline once the tick that began at `start` has written; return True if it missed its own."""
        if not self.realtime:
            overrun = now - start > self.period
            self.overruns += overrun
            return overrun
        self._deadline = (start if self._deadline is None else self._deadline) + self.period
        return self._skip_missed(now)

    def wait(self) -> None:
        if self._deadline is None:
            return
        self._skip_missed(perf_counter())  # whatever came after the command has taken its time as well
        while (left := self._deadline - perf_counter()) > 0.0:
            if left > _SPIN:
                sleep(left - _SPIN)

    def restart(self) -> None:
        """Forget the deadline: what has just happened was not a part of the loop."""
        self._deadline = None

    def _skip_missed(self, now: float) -> bool:
        if self._deadline is None or now <= self._deadline:
            return False
        missed = int((now - self._deadline) / self.period) + 1
        self._deadline += missed * self.period
        self.overruns += 1
        self.skipped += missed
        return True
