"""One open CAN channel: a thread that receives, a thread that sends, and what went wrong on it.

Nothing here raises once the channel is open: whatever the driver throws becomes a counter and an event, which the robot
turns into safety flags. Whoever hands over commands never touches the driver, and so never waits for the kernel.
"""

from __future__ import annotations

import errno
import math
import threading
import time
from collections.abc import Callable, Hashable, Sequence

import can

from humanoid_sim.hardware.bus.address import BusAddress, Echoes, error_number, frame_of, message_of, open_bus
from humanoid_sim.hardware.bus.events import BurstDetector, BusEvent, ChannelCounters, read_error_frame
from humanoid_sim.hardware.bus.frame import Frame

OpenBus = Callable[[BusAddress], can.BusABC]
Received = Callable[[Frame, float], None]
"""Takes a frame and the time at which it arrived, s, robot's clock; called on the receiver's thread."""

_POLL = 0.05
"""s that a thread waits before it looks whether the channel closes."""
_RETRY = 0.001
"""s until a frame is tried again that the kernel's queue had no room for; 7 frames leave in that time."""
_SEND_TIMEOUT = 0.005
"""s that a driver may wait for room by itself."""
_BACK_OFF = 0.005
"""s between two attempts to receive from a driver that failed."""
_TOLERATED = 10
"""Failures in a row without an error number after which the bus counts as down."""
_JOIN = 1.0
"""s that closing waits for a thread; a driver stuck in the kernel must not keep a robot from being closed."""
_LONGEST_DELAY = 10.0
"""s, beyond any receive timeout: what is older, after a suspended process, counts as so old."""

_DOWN = frozenset(
    {errno.ENETDOWN, errno.ENODEV, errno.ENXIO, errno.EBADF, errno.ENETUNREACH, errno.EIO, errno.ESHUTDOWN, errno.EPIPE}
)
_FULL = frozenset({errno.ENOBUFS, errno.EAGAIN, errno.EWOULDBLOCK})
_REAL_TIME_STAMPS = frozenset({"socketcan", "virtual", "udp_multicast"})
"""Interfaces whose frames carry the system's wall clock; other drivers count from wherever they like."""


class Channel:
    """An open channel with its two threads."""

    def __init__(
        self,
        address: BusAddress,
        receive: Received,
        *,
        open_bus: OpenBus = open_bus,
        clock: Callable[[], float] = time.monotonic,
        capacity: int = 256,
        patience: float = 0.016,
    ) -> None:
        """Open the bus and start receiving. Raises `RobotError` if the bus cannot be opened.

        Args:
            receive: is given every data frame, on the receiver's thread.
            clock: the robot's clock, s.
            capacity: frames that may wait to be sent.
            patience: s in which the queue must be empty again after the driver has refused a frame for want of room;
                a little less than a control period, so that the next tick knows.
        """
        self.address = address
        self.counters = ChannelCounters()
        self._receive_frame = receive
        self._clock = clock
        self._down = ""
        self._latest: dict[BusEvent, tuple[float, str]] = {}
        """By kind: when, s on the robot's clock, and what."""
        self._outbox = Outbox(capacity, self.counters, clock)
        self._patience = patience
        self._refused_since = math.inf
        self._burst = BurstDetector()
        self._echoes = Echoes(address, 2 * capacity)
        self._has_real_time = address.interface in _REAL_TIME_STAMPS
        self._receive_failures = 0
        self._send_failures = 0
        self._overruns_seen = 0
        self._closing = threading.Event()
        self._is_closed = False
        self._bus = open_bus(address)
        # Daemons: a driver that never returns must not keep the process, and with it the motors' commands, alive.
        self._threads = tuple(
            threading.Thread(target=target, name=f"{address} {name}", daemon=True)
            for name, target in (("receiver", self._receive), ("sender", self._send))
        )
        for thread in self._threads:
            thread.start()

    @property
    def down(self) -> str:
        """Return why nothing can be sent or heard, or empty. Stays until the channel is opened afresh."""
        for thread in self._threads:
            if not thread.is_alive() and not self._closing.is_set():
                return f"thread '{thread.name}' has ended"
        return self._down

    def recent(self, event: BusEvent, since: float) -> str:
        """Say what the latest event of a kind was, if it happened at or after `since` (s, robot's clock)."""
        when, text = self._latest.get(event, (-float("inf"), ""))
        return text if when >= since else ""

    def send(self, frames: Sequence[tuple[Hashable, Frame]], lifetime: float = math.inf) -> None:
        """Queue frames, each with its key or None, see `Outbox`; returns at once. `lifetime` in s."""
        self._outbox.put(frames, lifetime)
        if self.counters.overruns != self._overruns_seen:
            self._overruns_seen = self.counters.overruns
            self._note(BusEvent.TX_FULL, "commands do not leave in time")

    def forget_queue(self) -> None:
        """Drop frames that wait to be sent; one that the driver has at this moment may still leave."""
        self._outbox.clear()

    def forget_events(self) -> None:
        """Drop past events, but not that the channel is down; what happened before the motors were enabled is past."""
        self._latest.clear()

    def flush(self, timeout: float) -> bool:
        """Wait until everything queued was handed to the driver, at most `timeout` s; whether it was."""
        deadline = time.monotonic() + timeout
        while not self._outbox.is_empty and time.monotonic() < deadline:
            time.sleep(_RETRY)
        return self._outbox.is_empty

    def close(self) -> None:
        """Send what waits, stop both threads and close the bus. May be called twice; never raises."""
        if self._is_closed:
            return
        self._is_closed = True
        self.flush(0.2)
        self._closing.set()
        self._outbox.close()
        for thread in self._threads:
            thread.join(_JOIN)
        try:
            self._bus.shutdown()
        except Exception as error:  # a driver that is gone cannot say goodbye either
            self._note(BusEvent.DOWN, f"cannot be closed: {error}")

    def _note(self, event: BusEvent, text: str) -> None:
        self._latest[event] = (self._clock(), text)
        if event is BusEvent.DOWN and not self._down:
            self._down = text

    # --- receiver

    def _receive(self) -> None:
        while not self._closing.is_set():
            try:
                message = self._bus.recv(_POLL)
            except Exception as error:
                self._receive_failed(error)
                self._closing.wait(_BACK_OFF)
                continue
            if message is None:
                continue
            self._receive_failures = 0
            try:
                self._take(message)
            except Exception as error:
                self.counters.receiver_failures += 1
                self._note(BusEvent.UNREADABLE, f"frame not understood: {type(error).__name__}: {error}")

    def _take(self, message: can.Message) -> None:
        if message.is_error_frame:
            self._take_error(message)
            return
        # Whether `is_rx` does not matter: what another process of this machine sends on SocketCAN comes without it, and
        # what this one sends does not come back.
        if message.is_fd or len(message.data) > 8:
            self.counters.unusable += 1
            return
        frame = frame_of(message)
        if not self._echoes.take(frame):
            self.counters.received += 1
            self._receive_frame(frame, self._arrival(message.timestamp))

    def _take_error(self, message: can.Message) -> None:
        event, errors = read_error_frame(self.address.interface, message.arbitration_id, bytes(message.data))
        if event is BusEvent.NORMAL:
            self.counters.lost_arbitration += 1
            return
        self.counters.error_frames += 1
        self.counters.error_classes.update(errors)
        self._note(event, ", ".join(errors))
        self._watch_for_burst()

    def _watch_for_burst(self) -> None:
        """One more error on the bus. The message has the most frequent class: the latest would change all the time."""
        if self._burst.add(self._clock()):
            most = self.counters.error_classes.most_common(1)
            cause = f", mostly: {most[0][0]}" if most else ""
            self._note(BusEvent.BURST, f"more than {self._burst.rate:g} bus errors a second{cause}")

    def _arrival(self, stamp: float) -> float:
        """Return the time of arrival on the robot's clock.

        Where the driver stamps frames, a frame that lay in the kernel while this process was not running is as old as
        it is, and not as young as its reading.
        """
        now = self._clock()
        if not self._has_real_time or stamp <= 0.0:
            return now
        delay = time.time() - stamp
        return now - min(max(delay, 0.0), _LONGEST_DELAY)

    def _receive_failed(self, error: Exception) -> None:
        self.counters.receive_errors += 1
        self._receive_failures += 1
        number = error_number(error)
        if number in _DOWN or self._receive_failures >= _TOLERATED:
            self._note(BusEvent.DOWN, f"receiving fails: {error}")
        else:
            self._note(BusEvent.ERROR, f"receiving failed: {error}")
            self._watch_for_burst()

    # --- sender

    def _send(self) -> None:
        while True:
            item = self._outbox.take(_POLL)
            if item is None:
                self._refused_since = math.inf
                if self._outbox.is_closed:
                    return
                continue
            key, frame, until = item
            self._echoes.expect(frame)
            try:
                self._bus.send(message_of(frame), _SEND_TIMEOUT)
            except Exception as error:
                self._echoes.take(frame)  # it will not come back
                if self._send_failed(error):
                    self._outbox.give_back(key, frame, until)
                    self._closing.wait(_RETRY)
            else:
                self.counters.sent += 1
                self._send_failures = 0
                self._outbox.sent(key)
                if self._outbox.is_empty:
                    self._refused_since = math.inf

    def _send_failed(self, error: Exception) -> bool:
        """Take note; whether the frame is worth another attempt."""
        self._send_failures += 1
        number = error_number(error)
        # python-can reports a full buffer with an error number, with a timeout of its own, or with a text only.
        is_full = number in _FULL or isinstance(error, can.CanTimeoutError) or "buffer full" in str(error)
        if is_full:
            self.counters.retries += 1
            now = self._clock()
            self._refused_since = min(self._refused_since, now)
            if now - self._refused_since >= self._patience:
                self._note(BusEvent.TX_FULL, f"outgoing queue is full: {error}")
            return not self._closing.is_set()
        self.counters.send_errors += 1
        # Dropped: what cannot leave now must not leave later, when the motors have long been told otherwise.
        if number in _DOWN or self._send_failures >= _TOLERATED:
            self._note(BusEvent.DOWN, f"sending fails: {error}")
        else:
            self._note(BusEvent.TX_FULL, f"a frame could not be sent: {error}")
        return False


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

    def __init__(self, capacity: int, counters: ChannelCounters, clock: Callable[[], float] = time.monotonic) -> None:
        """Start empty; at most `capacity` frames wait. `clock` in s."""
        self.counters = counters
        """Takes what was superseded, what has become stale, and overruns."""
        self._capacity = capacity
        self._clock = clock
        self._ready = threading.Condition()
        self._waiting: dict[Hashable, tuple[float, Frame]] = {}
        # by key: until when the frame may leave, and the frame
        self._jammed_since: dict[Hashable, float] = {}
        self._serial = 0
        self.is_closed = False
        """True once `close` was called."""

    def put(self, frames: Sequence[tuple[Hashable, Frame]], lifetime: float = math.inf) -> None:
        """Queue keyed frames for `lifetime` s at most; a key None keeps a frame apart. Never blocks on the bus."""
        until = self._clock() + lifetime
        with self._ready:
            if self.is_closed:
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
            self.counters.overruns += 1
            return
        self._waiting[key] = until, frame  # a replaced frame keeps its place: a dict remembers the first insertion

    def _count_replaced(self, key: Hashable) -> None:
        now = self._clock()
        self.counters.superseded += 1
        self.counters.overruns += now - self._jammed_since.setdefault(key, now) > _PATIENCE

    def take(self, timeout: float) -> tuple[Hashable, Frame, float] | None:
        """Return the next key, its frame, and until when it may leave, or None if `timeout`, s, passes without."""
        with self._ready:
            if not self._waiting and not self.is_closed:
                self._ready.wait(timeout)
            now = self._clock()
            while self._waiting:
                key = next(iter(self._waiting))
                until, frame = self._waiting.pop(key)
                if now <= until:
                    return key, frame, until
                self.counters.stale += 1
            return None

    def sent(self, key: Hashable) -> None:
        """Note that a frame that was taken has left."""
        if key in self._jammed_since:
            with self._ready:
                self._jammed_since.pop(key, None)

    def give_back(self, key: Hashable, frame: Frame, until: float = math.inf) -> None:
        """Put a frame that could not be sent back in front, unless a newer one with its key has come."""
        with self._ready:
            if self.is_closed:
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
            self.is_closed = True
            self._ready.notify_all()
