"""The sinks of a run as one: a sink that raises is left out, and the loop goes on without it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence

from humanoid_sim.session.sink import SessionHeader, Sink, TickRecord

__all__ = ["SinkGroup"]


class SinkGroup:
    """Hands ticks and events to every sink that still works: a broken viewer must not stop a robot in mid-motion."""

    def __init__(self, sinks: Sequence[Sink], clock: Callable[[], float]) -> None:
        """Prepare.

        Args:
            sinks: in the order in which they are handed each tick.
            clock: s, the robot's clock, for the event that says that a sink is left out.
        """
        self._sinks = tuple(sinks)
        self._clock = clock
        self.failures: list[str] = []
        """Sinks that were left out, each with its exception."""

    def start(self, header: SessionHeader, stack: contextlib.ExitStack) -> None:
        """Start the sinks in order, and have `stack` close those that did.

        Raises:
            InputError: if one cannot start.
        """
        for sink in self._sinks:
            sink.start(header)
            stack.callback(sink.close)

    def tick(self, record: TickRecord) -> None:
        """Hand out a tick."""
        for sink in self._sinks:
            try:
                sink.tick(record)
            except Exception as error:
                self._drop(sink, error)

    def event(self, text: str) -> None:
        """Hand out something that happened outside the ticks, now."""
        for sink in self._sinks:
            try:
                sink.event(self._clock(), text)
            except Exception as error:
                self._drop(sink, error)

    def lags(self, ticks: int) -> bool:
        """Whether a sink is more than `ticks` behind."""
        return any(sink.backlog > ticks for sink in self._sinks)

    def _drop(self, sink: Sink, error: Exception) -> None:
        if all(other is not sink for other in self._sinks):  # it failed once more at the news of another's failure
            return
        failure = f"{type(sink).__name__}: {type(error).__name__}: {error}"
        self._sinks = tuple(other for other in self._sinks if other is not sink)
        self.failures.append(failure)
        self.event(f"left out from here on: {failure}")
