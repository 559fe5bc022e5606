"""Several sinks as one, and what becomes of those that fail."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence

from humanoid_sim.messages import Event, EventKind, SessionHeader, TickRecord
from humanoid_sim.recording.sink import Sink


class SinkGroup:
    """Hands ticks and events to every sink that still works: a broken viewer must not stop a robot in mid-motion."""

    def __init__(self, sinks: Sequence[Sink], clock: Callable[[], float]) -> None:
        """Hand out in this order; `clock` is the robot's, s, for events."""
        self._sinks, self._clock = tuple(sinks), clock
        self.failures: list[str] = []  # sinks that were left out, each with its exception

    def start(self, header: SessionHeader, stack: contextlib.ExitStack) -> None:
        for sink in self._sinks:
            sink.start(header)
            stack.callback(sink.close)

    def tick(self, record: TickRecord) -> None:
        self._hand(lambda sink: sink.tick(record))

    def event(self, text: str, kind: EventKind = EventKind.NOTE) -> None:
        event = Event(self._clock(), text, kind)
        self._hand(lambda sink: sink.event(event))

    def _hand(self, call: Callable[[Sink], None]) -> None:
        for sink in self._sinks:
            try:
                call(sink)
            except Exception as error:
                others = tuple(other for other in self._sinks if other is not sink)
                if len(others) < len(self._sinks):  # else it failed once more, at the news of another's failure
                    failure = f"{type(sink).__name__}: {type(error).__name__}: {error}"
                    self._sinks = others
                    self.failures.append(failure)
                    self.event(f"left out from here on: {failure}", EventKind.FAILURE)
