"""Joints that have come to rest."""

from __future__ import annotations

import numpy as np

from humanoid_sim.mit import MITState

_REST_VELOCITY = 0.02  # rad/s below which a joint is slow
_REST_TIME = 0.5  # s for which every joint must be slow: a held arm is slow when it is let go, and falls after
_OLD = 0.2  # s since a joint answered, after which its last velocity says nothing


class RestDetector:
    """Detects that the joints have come to rest: all of them slow, for a while."""

    def __init__(self, period: float) -> None:
        self._needed = max(round(_REST_TIME / period), 1)
        self._slow = 0

    def update(self, state: MITState) -> bool:
        """Return True if the joints are at rest."""
        known = np.abs(state.joint_velocity[np.isfinite(state.joint_velocity)])
        answers = bool((state.joint_age <= _OLD).all())
        is_slow = answers and known.size > 0 and bool((known < _REST_VELOCITY).all())
        self._slow = self._slow + 1 if is_slow else 0
        return self._slow > self._needed
