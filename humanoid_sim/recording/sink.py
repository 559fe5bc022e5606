"""What takes the ticks and events of a run: the interface, and a base of those that work on a thread of their own."""

from __future__ import annotations

import threading
from collections import deque
from typing import Protocol

from humanoid_sim.errors import reason_of
from humanoid_sim.messages import Event, SessionHeader, TickRecord

QUEUE_LIMIT = 4096  # ticks and events that may wait (20 s at 200 Hz); beyond that they are left out and counted
_BATCH = 64  # ticks and events that an inline sink deals with together: with warm caches it takes half as long


class Sink(Protocol):
    """Takes ticks and events; never makes the control thread wait. A subclass defines only what it needs."""

    def start(self, header: SessionHeader) -> None:
        """Start before the first tick. Raises `InputError` if it cannot do its job."""
        return

    def tick(self, record: TickRecord) -> None:
        return

    def event(self, event: Event) -> None:
        """Take an event, which may come from any thread."""
        return

    def close(self) -> None:
        """Deal with what is left after the last tick, release files and threads. Called once."""
        return


class WorkerSink(Sink):
    """Base of sinks: the control thread appends to a queue, a worker thread deals with it in order.

    In a run without deadlines a sink may work `inline`, on the control thread in batches, so that nothing is lost
    however fast the run is.

    Subclasses override `handle_*`. If one raises, the sink stops working and keeps the reason in `error`; the loop goes
    on without it. If one does not return, `close` does not wait for it.
    """

    stuck_after = 5.0  # s that a sink may take over all that is left when it is closed

    def __init__(self, name: str, period: float = 0.05, *, inline: bool = False) -> None:
        """Name the thread, which looks at the queue every `period` s."""
        self.error: str | None = None
        self.lost = 0  # ticks and events left out because the worker could not keep up
        self._queue: deque[TickRecord | Event] = deque()
        self._period, self._inline = period, inline
        self._is_open, self._stop = False, threading.Event()
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)

    def start(self, header: SessionHeader) -> None:
        self._is_open = True
        if not self._inline:
            self._thread.start()

    def tick(self, record: TickRecord) -> None:
        self._put(record)
        if self._inline and len(self._queue) >= _BATCH:
            self._drain()

    def event(self, event: Event) -> None:
        self._put(event)

    def _put(self, item: TickRecord | Event) -> None:
        if len(self._queue) >= QUEUE_LIMIT:
            self.lost += 1
        elif self.error is None:
            self._queue.append(item)

    @property
    def is_alive(self) -> bool:
        return self._thread.is_alive()

    def close(self) -> None:
        """Let the rest of the queue be dealt with; leave a thread behind that does not end."""
        was_open, self._is_open = self._is_open, False
        if was_open and self._inline:
            self._finish()
        elif was_open:
            self._stop.set()
            self._thread.join(self.stuck_after)
            if self._thread.is_alive():
                self._fail(TimeoutError(f"did not finish within {self.stuck_after:g} s"))

    def handle_tick(self, record: TickRecord) -> None:
        pass

    def handle_event(self, event: Event) -> None:
        pass

    def handle_pause(self) -> None:
        """Use the pause after the queue has been emptied."""

    def handle_close(self) -> None:
        """Close after the last tick, on the worker's thread."""

    def handle_failure(self, error: BaseException) -> str:
        """Release what is open after a handler raised; return the reason, a line, for `error`."""
        return reason_of(error)

    def _work(self) -> None:
        while not self._stop.wait(self._period) and self.error is None:
            self._drain()
        self._finish()

    def _finish(self) -> None:
        self._drain()
        if self.error is None:
            try:
                self.handle_close()
            except Exception as error:
                self._fail(error)

    def _drain(self) -> None:
        try:
            while self._queue:
                item = self._queue.popleft()
                if isinstance(item, TickRecord):
                    self.handle_tick(item)
                else:
                    self.handle_event(item)
            if self.error is None:
                self.handle_pause()
        except (Exception, SystemExit) as error:  # kept for the program to report; rich exits where a pipe has broken
            self._fail(error)

    def _fail(self, error: BaseException) -> None:
        self._queue.clear()
        if self.error is None:
            self.error = self.handle_failure(error)
