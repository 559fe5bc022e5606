"""What a session refuses of other programs: counted, and told at a rate that a person can read."""

from __future__ import annotations

import math
from collections.abc import Callable

from humanoid_sim.session.ownership import Producer

_PERIOD = 1.0
"""s between two lines about one producer."""
_LONGEST = 1000
"""Characters of a reason."""
_MOST = 256
"""Different refusals that are remembered, so that each is told once, and producers that are told apart."""


class Refusals:
    """Each reason of a producer's is told once until `forget`, and of one producer at most one line per second."""

    def __init__(self, tell: Callable[[str], object]) -> None:
        """Start with none; `tell` takes a line."""
        self._tell = tell
        self._reasons: dict[tuple[str, str], bool] = {}
        """Whether a producer's reason is still to be told."""
        self._told_at: dict[str, float] = {}
        """s, robot's clock, by producer."""
        self.counts: dict[str, int] = {}
        """Samples of each producer's, since the session began; of those beyond the first so many under `others`."""
        self.latest = ""
        """The latest, as one line."""

    @property
    def count(self) -> int:
        """Samples, since the session began."""
        return sum(self.counts.values())

    @property
    def lines(self) -> tuple[str, ...]:
        """What was refused since the last `forget`, one line each."""
        return tuple(f"{producer}: {reason}" for producer, reason in sorted(self._reasons))

    def add(self, producer: Producer, reason: str, count: int = 1) -> None:
        """Count a refusal; `count` samples for this reason."""
        name = str(producer) if str(producer) in self.counts or len(self.counts) < _MOST else "others"
        self.counts[name] = self.counts.get(name, 0) + count
        # Others chose these words: no line ends and nothing that steers a terminal, and not too many of them.
        reason = "".join(c if c.isprintable() else "?" for c in reason[:_LONGEST])
        self.latest = f"{producer}: {reason}"
        if len(self._reasons) < _MOST:
            self._reasons.setdefault((str(producer), reason), True)

    def forget(self) -> None:
        """What is refused from here on is told again."""
        self._reasons = {key: True for key, is_new in self._reasons.items() if is_new}

    def flush(self, time: float) -> None:
        """Tell what may be told at a time in s, robot's clock."""
        if not any(self._reasons.values()):
            return
        if len(self._told_at) > _MOST:
            self._told_at.clear()
        for (producer, reason), is_new in self._reasons.items():
            # Also when the clock has jumped back.
            if is_new and not abs(time - self._told_at.get(producer, -math.inf)) < _PERIOD:
                self._told_at[producer] = time
                self._reasons[producer, reason] = False
                self._tell(f"refused of {producer}: {reason}")
