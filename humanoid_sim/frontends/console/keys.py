"""A piano's keys for pages: which are down, and which the policy's song asks for."""

from __future__ import annotations

from typing import Any

import numpy as np

from humanoid_sim.messages import SessionHeader, TickRecord
from humanoid_sim.mit import KEY_PRESSED, FloatArray
from humanoid_sim.rendering.ghost import ShownReference
from humanoid_sim.robots.piano import KEY_COUNT
from humanoid_sim.stack import no_policy, recorded_policy

__all__ = ["ShownKeys"]

_SHOWN = 0.1
"""s for which a stroke is shown at least: pages are told ten times a second."""


class ShownKeys:
    """Of one session, for all pages."""

    def __init__(self, header: SessionHeader) -> None:
        """Find the goals. Raises `InputError` if the header is damaged."""
        loaded = recorded_policy(header, no_policy)
        self._goals = None if loaded is None else loaded.reference.terms.get("target_keys")
        self._reference = ShownReference()
        self._last: FloatArray = np.full(KEY_COUNT, -np.inf)
        """Shape (88,), s: when each key was down, the last time."""

    def look(self, record: TickRecord) -> None:
        """Take a tick, of which every one must be seen."""
        self._reference.look(record)
        now, heard = float(record.input.state.time), record.input.state.extern.get(KEY_PRESSED)
        if (self._last > now).any():  # time begins again after a reactivation
            self._last[:] = -np.inf
        if heard is not None and heard.value.shape == (KEY_COUNT,):
            self._last[heard.at(now) > 0.0] = now

    def told(self, record: TickRecord) -> dict[str, Any] | None:
        """For all pages; None of a session that has nothing to do with a piano.

        `down` and `wanted` are the numbers of keys, the lowest is 0: null while nobody knows which are down, and while
        no policy plays.
        """
        now, heard = float(record.input.state.time), record.input.state.extern.get(KEY_PRESSED)
        if heard is None and self._goals is None:
            return None
        frame = self._reference.frame
        is_known = heard is not None and now - heard.arrival_time <= heard.timeout
        wanted = None if self._goals is None or frame is None else np.flatnonzero(self._goals[frame]).tolist()
        return {"down": np.flatnonzero(self._last > now - _SHOWN).tolist() if is_known else None, "wanted": wanted}
