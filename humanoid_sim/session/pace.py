"""Timing of a control loop: its settings, its deadlines and what misses them, and how late it wakes up."""

from __future__ import annotations

import math
from dataclasses import dataclass
from time import perf_counter, sleep

import numpy as np


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """Settings of the loop: how it keeps time, and how it ends."""

    control_period: float
    """s"""
    realtime: bool = True
    """Keep real time. A simulated robot may run as fast as it can instead."""
    simulated: bool = False
    """Writing to the robot also advances its physics, which then does not count as a tick's own time."""
    duration: float | None = None
    """s on the robot's clock after which the run ends; None: when a source says so, or QUIT."""
    punctual: bool = False
    """Take the measures of `humanoid_sim.session.realtime` while the robot is active."""
    damping_time: float = 3.0
    """s at most that the end of a run stays in DAMPING for the joints to come to rest."""


_LOWEST = 1e-7  # s, the lower edge of the first bin
_PER_DECADE = 50  # bins per decade: a percentile is exact to 10^(1/50), that is 4.7 %
_DECADES = 9


class DurationHistogram:
    """Logarithmic bins from 0.1 µs to 100 s; count, mean and maximum are exact, percentiles to within 5 %."""

    def __init__(self) -> None:
        self._bins = np.zeros(_PER_DECADE * _DECADES, dtype=np.int64)
        self._sum = 0.0
        self.count = 0
        self.max = 0.0

    def add(self, seconds: float) -> None:
        """Count one duration, s."""
        bin_index = int(_PER_DECADE * math.log10(max(seconds, _LOWEST) / _LOWEST))
        self._bins[min(bin_index, len(self._bins) - 1)] += 1
        self._sum += seconds
        self.count += 1
        self.max = max(self.max, seconds)

    @property
    def mean(self) -> float:
        """s; 0 if nothing was counted."""
        return self._sum / self.count if self.count else 0.0

    def percentile(self, percent: float) -> float:
        """Duration in s that `percent` of the counted ones do not exceed; 0 if nothing was counted."""
        if not self.count:
            return 0.0
        rank = max(math.ceil(self.count * percent / 100.0), 1)
        bin_index = int(np.searchsorted(np.cumsum(self._bins), rank))
        return float(min(_LOWEST * 10.0 ** ((bin_index + 1) / _PER_DECADE), self.max))


_SPIN = 0.0002  # s before a deadline that are spent spinning: `sleep` wakes up to this much late on a common kernel


class Pace:
    """The deadlines of a loop with a fixed period; one that has passed is skipped, never caught up.

    Without real time there are none, and a tick that took longer than a period counts as an overrun instead.
    """

    def __init__(self, period: float, *, realtime: bool) -> None:
        """Begin with no deadline, which the first tick sets; `period` in s."""
        self._period, self._realtime = period, realtime
        self.overruns = 0
        """Ticks that missed their deadline."""
        self.skipped = 0
        """Deadlines that passed while a tick was still running."""
        self.jitter = DurationHistogram()
        """Delay of each tick's start after its due time. Empty without real time."""
        self._deadline: float | None = None

    def begin(self) -> float:
        """Note that a tick begins; return when, s."""
        now = perf_counter()
        if self._deadline is not None:
            self.jitter.add(max(now - self._deadline, 0.0))
        return now

    def written(self, start: float, now: float) -> bool:
        """Set the next deadline once the tick that began at `start` has written; True if it missed its own."""
        if not self._realtime:
            overrun = now - start > self._period
            self.overruns += overrun
            return overrun
        self._deadline = (start if self._deadline is None else self._deadline) + self._period
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
        """Forget the deadline: what has just happened was not a part of the loop."""
        self._deadline = None

    def _skip_missed(self, now: float) -> bool:
        """Move a deadline that has passed on to the next one that has not."""
        if self._deadline is None or now <= self._deadline:
            return False
        missed = int((now - self._deadline) / self._period) + 1
        self._deadline += missed * self._period
        self.overruns += 1
        self.skipped += missed
        return True
