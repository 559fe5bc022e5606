"""Lines for the events, of a bounded number per second: what other programs do may be worth a line in every tick."""

from __future__ import annotations

import math
from collections.abc import Callable

_MOST_LINES = 10
"""Per second, and at once."""


class BoundedTelling:
    """Tells a line, unless there were too many."""

    def __init__(self, tell: Callable[[str], None], clock: Callable[[], float]) -> None:
        """Start with a second's lines; `clock` in s."""
        self._tell, self._clock = tell, clock
        self._left, self._refilled = float(_MOST_LINES), -math.inf

    def __call__(self, text: str) -> bool:
        """Return whether the line was told."""
        time = self._clock()
        if time > self._refilled:
            self._left = min(self._left + (time - self._refilled) * _MOST_LINES, _MOST_LINES)
        self._refilled = time
        if self._left < 1.0:
            return False
        self._left -= 1.0
        self._tell(text)
        return True
