"""Durations of a run of any length in constant memory."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

__all__ = ["DurationHistogram"]

_LOWEST = 1e-7
"""s, the lower edge of the first bin."""
_PER_DECADE = 50
"""Bins per decade: a percentile is exact to 10^(1/50), that is 4.7 %."""
_DECADES = 9


class DurationHistogram:
    """Logarithmic bins from 0.1 µs to 100 s; count, mean and maximum are exact, percentiles to within 5 %."""

    def __init__(self) -> None:
        """Start empty."""
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

    def counts(self, edges: Sequence[float]) -> tuple[int, ...]:
        """How many durations lie up to the first edge, between that and the second, …, and beyond the last.

        Args:
            edges: s, ascending; each is moved by less than 5 % to where two bins meet.
        """
        cuts = [round(_PER_DECADE * math.log10(max(edge, _LOWEST) / _LOWEST)) for edge in edges]
        return tuple(int(part.sum()) for part in np.split(self._bins, cuts))
