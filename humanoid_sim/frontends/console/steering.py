"""A velocity command from a page: whose it is, what it says, and when it ends. No clock, no socket."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from humanoid_sim.client import VELOCITY_TIMEOUT
from humanoid_sim.errors import FieldError, known_names
from humanoid_sim.frontends.console.wishes import SEEN_WITHIN
from humanoid_sim.messages import Mode
from humanoid_sim.mit import FloatArray
from humanoid_sim.session.sources import VELOCITY_KEYS

_DELIBERATE = 0.1
"""s for which a change is sent as deliberate: of what arrives within one tick only the newest counts."""


@dataclass(frozen=True, slots=True)
class Due:
    """A velocity command to send."""

    velocity: tuple[float, float, float]
    """m/s, m/s, rad/s."""
    deliberate: bool
    heard: int
    """Time of the latest message from its page, CLOCK_MONOTONIC ns, from which its age counts."""


class Steering:
    """At most one page steers: the one that changed the velocity last. A slider at rest claims nothing."""

    def __init__(self, ranges: FloatArray) -> None:
        """Nobody steers; `ranges` has shape (3, 2): m/s, m/s, rad/s, zero among them."""
        self._ranges = ranges
        self.page: int | None = None
        self.velocity: FloatArray = np.zeros(3)
        """Shape (3,), m/s, m/s, rad/s."""
        self.changed = self._heard = self._seen = 0
        """ns"""

    def press(self, page: int, key: str, present: FloatArray, mode: Mode, now: int) -> None:
        """Take a velocity key: a step from `present`, shape (3,), the command that counts, whoever's it is; or a stop.

        Raises:
            FieldError: no such key, or the robot does not walk; a stop is always taken.
        """
        if key not in VELOCITY_KEYS:
            raise FieldError(f"velocity: {known_names('key', key[:20], tuple(VELOCITY_KEYS))}")
        change = VELOCITY_KEYS[key]
        before = self.velocity if self.page == page else present
        after: FloatArray = before + np.array(change, dtype=np.float64) if any(change) else np.zeros(3)
        self._take(page, after, mode, now)

    def steer(self, page: int, axis: int, value: float, present: FloatArray, mode: Mode, now: int) -> None:
        """Take a slider: one component anew. Arguments and errors as for `press`."""
        if axis not in range(3):
            raise FieldError(f"velocity: axis is {axis}, expected 0, 1 or 2")
        if not math.isfinite(value):
            raise FieldError(f"velocity: is {value}, expected a finite number")
        velocity: FloatArray = np.array(self.velocity if self.page == page else present)
        velocity[axis] = value
        self._take(page, velocity, mode, now)

    def _take(self, page: int, velocity: FloatArray, mode: Mode, now: int) -> None:
        bounded: FloatArray = np.clip(velocity, self._ranges[:, 0], self._ranges[:, 1]).round(6)
        if bounded.any() and mode is not Mode.LOCOMOTION:
            raise FieldError(f"velocity refused: requires LOCOMOTION, mode is {mode.name}")
        self.page, self.velocity, self.changed = page, bounded, now
        self._heard = self._seen = now

    def beat(self, page: int, now: int, seen: int) -> None:
        """Note that a page was heard; `seen` (ns) is when what it shows left the console."""
        if page == self.page:
            self._heard, self._seen = now, seen

    def let_go(self) -> None:
        """Nobody steers any more; what was commanded last ends by itself."""
        self.page, self.velocity = None, np.zeros(3)

    def problem(self, mode: Mode, owner: str | None, now: int) -> str:
        """Return why its page steers no longer; empty if it still does.

        `owner` is whom else the velocity belongs to, None for nobody else; `now` in ns.
        """
        if 1e-9 * (now - self._heard) > VELOCITY_TIMEOUT:
            return f"page {self.page} was not heard for {VELOCITY_TIMEOUT:g} s"
        if 1e-9 * (now - self._seen) > SEEN_WITHIN:
            return f"page {self.page} shows what is older than {SEEN_WITHIN:g} s"
        if self.velocity.any() and mode is not Mode.LOCOMOTION:
            return f"mode is {mode.name}"
        if owner is None:
            return ""
        return f"{owner} controls it now" if owner else "no longer controlled by anyone"

    def due(self, now: int) -> Due | None:
        """Return what to send at present; None if nothing. A stop is sent for as long as it is news."""
        if self.page is None:
            return None
        deliberate = 1e-9 * (now - self.changed) <= _DELIBERATE
        if not deliberate and not self.velocity.any():
            self.let_go()
            return None
        vx, vy, wz = self.velocity.tolist()
        return Due((vx, vy, wz), deliberate, self._heard)
