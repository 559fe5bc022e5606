"""Sinks for the ticks and events of a run: their interface, several as one, and one that works on its own thread."""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import Protocol

from humanoid_sim.messages import Event, EventKind, SessionHeader, TickRecord

QUEUE_LIMIT = 4096  # ticks and events that may wait (20 s at 200 Hz); beyond that they are left out and counted
_STUCK_AFTER = 5.0  # s that a sink may take over all that is left when it is closed


class Sink(Protocol):
    """Takes ticks and events; never makes the control thread wait. A subclass defines only what it needs."""

    backlog_limit: int = 2000  # ticks

    def start(self, header: SessionHeader) -> None:
        """Start before the first tick. Raises `InputError` if it cannot do its job."""
        return

    def tick(self, record: TickRecord) -> None:
        return

    def event(self, event: Event) -> None:
        return

    @property
    def backlog(self) -> int:
        """Ticks taken but not yet dealt with. A run without deadlines waits for a long one."""
        return 0

    def close(self) -> None:
        """Deal with what is left after the last tick, release files and threads. Called once."""
        return


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

    def lags(self) -> bool:
        return any(sink.backlog > sink.backlog_limit for sink in self._sinks)

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


class WorkerSink(Sink):
    """Base of sinks: the control thread appends to a queue, a worker thread deals with it in order.

    Subclasses override `handle_*`. If one raises, the sink stops working and keeps the exception in `error`; the loop
    goes on without it. If one does not return, `close` does not wait for it.
    """

    def __init__(self, name: str, period: float = 0.05) -> None:
        """Name the thread, which looks at the queue every `period` s."""
        self.error: BaseException | None = None
        self.lost = 0  # ticks and events left out because the worker could not keep up
        self._queue: deque[TickRecord | Event] = deque()
        self._period = period
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)

    def start(self, header: SessionHeader) -> None:
        self._thread.start()

    def tick(self, record: TickRecord) -> None:
        self._put(record)

    def event(self, event: Event) -> None:
        self._put(event)

    def _put(self, item: TickRecord | Event) -> None:
        if len(self._queue) >= QUEUE_LIMIT:
            self.lost += 1
        elif self.error is None:
            self._queue.append(item)

    @property
    def backlog(self) -> int:
        return len(self._queue)

    @property
    def is_alive(self) -> bool:
        return self._thread.is_alive()

    def close(self) -> None:
        """Let the thread deal with the rest of the queue and end; leave it behind if it does not."""
        self._stop.set()
        if self._thread.ident is None:
            return
        self._thread.join(_STUCK_AFTER)
        if self._thread.is_alive():
            self.error = self.error or TimeoutError(f"did not finish within {_STUCK_AFTER:g} s")
            self._queue.clear()

    def handle_tick(self, record: TickRecord) -> None:
        pass

    def handle_event(self, event: Event) -> None:
        pass

    def handle_pause(self) -> None:
        """Use the pause after the queue has been emptied."""

    def handle_close(self) -> None:
        """Close after the last tick, on the worker's thread."""

    def _work(self) -> None:
        try:
            is_last = False
            while not is_last:
                is_last = self._stop.wait(self._period)
                self._drain()
            self.handle_close()
        except (Exception, SystemExit) as error:  # kept for the program to report; rich exits where a pipe has broken
            self.error = error
            self._queue.clear()

    def _drain(self) -> None:
        while self._queue:
            item = self._queue.popleft()
            if isinstance(item, TickRecord):
                self.handle_tick(item)
            else:
                self.handle_event(item)
        self.handle_pause()
