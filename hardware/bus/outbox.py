"""Frames on their way out: bounded, and never staler than need be."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Hashable, Sequence

from humanoid_sim.hardware.bus.frame import Frame

_PATIENCE = 0.06
"""s that a motor's commands may be replaced unsent before that counts as an overrun. Less is a late thread; more comes
close to the motors' CAN timeout."""


class Outbox:
    """Queue of frames from the thread that wants them sent to the thread that sends them.

    Frames leave in order of arrival. A frame with a key (a motor's MIT command) replaces an unsent one with that key
    and takes its place: once the bus is free again the newest command leaves at once, and not behind a queue of old
    ones, which is what a DAMP after a jam needs. A replaced command is counted. Where none has left for 60 ms, the
    queue has overrun; so it has when it is full. A frame with a lifetime is dropped once that is over: nobody may have
    renewed it, because the whole process stood still, and the robot is elsewhere by now.
    """

    def __init__(self, capacity: int, clock: Callable[[], float] = time.monotonic) -> None:
        """Start empty; at most `capacity` frames wait. `clock` in s."""
        self._capacity = capacity
        self._clock = clock
        self._ready = threading.Condition()
        self._waiting: dict[Hashable, tuple[float, Frame]] = {}
        # by key: until when the frame may leave, and the frame
        self._jammed_since: dict[Hashable, float] = {}
        self._serial = 0
        self._is_closed = False
        self.superseded = 0
        """Commands that a newer one replaced before they were sent."""
        self.overruns = 0
        """Frames that found the queue full, and commands replaced although none had left for too long."""
        self.stale = 0
        """Frames that outlived their lifetime here."""

    def put(self, frames: Sequence[tuple[Hashable, Frame]], lifetime: float = math.inf) -> None:
        """Queue keyed frames; a key None keeps a frame apart from all others. Never blocks on the bus.

        Args:
            lifetime: s after which they are dropped if they have not left.
        """
        until = self._clock() + lifetime
        with self._ready:
            if self._is_closed:
                return
            for key, frame in frames:
                self._put(key, frame, until)
            self._ready.notify()

    def _put(self, key: Hashable, frame: Frame, until: float) -> None:
        if key is None:
            self._serial += 1
            key = (Outbox, self._serial)
        if key in self._waiting:
            self._count_replaced(key)
        elif len(self._waiting) >= self._capacity:
            self.overruns += 1
            return
        self._waiting[key] = until, frame  # a replaced frame keeps its place: a dict remembers the first insertion

    def _count_replaced(self, key: Hashable) -> None:
        now = self._clock()
        self.superseded += 1
        self.overruns += now - self._jammed_since.setdefault(key, now) > _PATIENCE

    def take(self, timeout: float) -> tuple[Hashable, Frame, float] | None:
        """Return the next frame, or None if `timeout` (s) passes without one. A frame that cannot be sent: `give_back`.

        Returns:
            Its key, itself, and until when it may leave.
        """
        with self._ready:
            if not self._waiting and not self._is_closed:
                self._ready.wait(timeout)
            now = self._clock()
            while self._waiting:
                key = next(iter(self._waiting))
                until, frame = self._waiting.pop(key)
                if now <= until:
                    return key, frame, until
                self.stale += 1
            return None

    def sent(self, key: Hashable) -> None:
        """Note that a frame that was taken has left."""
        if key in self._jammed_since:
            with self._ready:
                self._jammed_since.pop(key, None)

    def give_back(self, key: Hashable, frame: Frame, until: float = math.inf) -> None:
        """Put a frame that could not be sent back in front, unless a newer one with its key has come."""
        with self._ready:
            if self._is_closed:
                return
            if key in self._waiting:
                self._count_replaced(key)
            else:
                self._waiting = {key: (until, frame), **self._waiting}

    def clear(self) -> None:
        """Forget everything that waits."""
        with self._ready:
            self._waiting.clear()
            self._jammed_since.clear()

    @property
    def is_empty(self) -> bool:
        """Return whether nothing waits."""
        return not self._waiting

    def close(self) -> None:
        """Take no more frames, and let the taker go once those that wait are gone."""
        with self._ready:
            self._is_closed = True
            self._ready.notify_all()

    @property
    def is_closed(self) -> bool:
        """Return whether `close` was called."""
        return self._is_closed
