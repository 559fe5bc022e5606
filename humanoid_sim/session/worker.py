"""A sink that does its work on a thread of its own."""

from __future__ import annotations

import threading
from collections import deque

from humanoid_sim.session.sink import SessionHeader, TickRecord

__all__ = ["WorkerSink"]


class WorkerSink:
    """Base of sinks: the control thread appends to a queue, a worker thread deals with it in order.

    Subclasses override `handle_*`. If one raises, the sink stops working and keeps the exception in `error`; the loop
    goes on without it.
    """

    def __init__(self, name: str, period: float = 0.05) -> None:
        """Prepare a sink.

        Args:
            name: of the thread.
            period: s between two looks at the queue.
        """
        self.error: BaseException | None = None
        self._queue: deque[TickRecord | tuple[float, str]] = deque()
        self._period = period
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)

    def start(self, header: SessionHeader) -> None:
        """Begin."""
        self.handle_start(header)
        self._thread.start()

    def tick(self, record: TickRecord) -> None:
        """Queue a tick."""
        if self.error is None:
            self._queue.append(record)

    def event(self, time: float, text: str) -> None:
        """Queue an event."""
        if self.error is None:
            self._queue.append((time, text))

    @property
    def backlog(self) -> int:
        """Length of the queue."""
        return len(self._queue)

    def close(self) -> None:
        """Deal with the rest of the queue and end the thread."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()
        if self.error is None:
            self._guarded_drain()
        try:
            self.handle_close()
        except Exception as error:  # a sink that cannot finish must not keep the session from closing the robot
            self.error = self.error or error

    def handle_start(self, header: SessionHeader) -> None:
        """Called before the first tick, on the caller's thread."""

    def handle_tick(self, record: TickRecord) -> None:
        """Called for every tick, on the worker's thread."""

    def handle_event(self, time: float, text: str) -> None:
        """Called for every event, in order with the ticks."""

    def handle_pause(self) -> None:
        """Called each time the queue has been emptied."""

    def handle_close(self) -> None:
        """Called after the last tick, on the caller's thread."""

    def _work(self) -> None:
        while not self._stop.wait(self._period):
            self._guarded_drain()
            if self.error is not None:
                return

    def _guarded_drain(self) -> None:
        try:
            while self._queue:
                item = self._queue.popleft()
                if isinstance(item, TickRecord):
                    self.handle_tick(item)
                else:
                    self.handle_event(*item)
            self.handle_pause()
        except (Exception, SystemExit) as error:  # kept for the program to report; rich exits where a pipe has broken
            self.error = error
            self._queue.clear()
