"""One open CAN channel: a thread that receives, a thread that sends, and what went wrong on it.

Nothing here raises once the channel is open: whatever the driver throws becomes a counter and an event, which the robot
turns into safety flags. The control thread never touches the driver, and so never waits for the kernel.
"""

from __future__ import annotations

import errno
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import can

from humanoid_sim.hardware.bus.address import BusAddress, error_number, open_bus
from humanoid_sim.hardware.bus.frame import Echoes, Frame, frame_of, message_of

OpenBus = Callable[[BusAddress], can.BusABC]
Received = Callable[[Frame, float], None]
"""Takes a frame and the time at which it arrived, s, robot's clock; called on the receiver's thread."""


class BusEvent(Enum):
    """What an error means for the robot on this bus."""

    DOWN = "down"
    """The controller has left the bus, or the interface is gone: nothing is sent or received."""
    TX_FULL = "outgoing queue full"
    """Frames do not leave as fast as they come."""
    ERROR = "bus error"
    """A frame was damaged on the wire, and nobody can tell whose. CAN sends it again; what is lost all the same is
    missed elsewhere: a joint falls silent, a queue does not empty."""
    BURST = "burst of bus errors"
    """More of them than a bus recovers from unnoticed: a plug that is pulled gives half a dozen, and a controller
    leaves the bus by itself at 78 a second, where 14 motors are commanded at 50 Hz."""
    UNREADABLE = "frame not understood"
    """A frame arrived whole, and its handling failed."""


class Note(NamedTuple):
    """Something that happened."""

    time: float
    """s, robot's clock."""
    text: str


NEVER = Note(-math.inf, "")


@dataclass(slots=True)
class ChannelCounters:
    """Counters of a channel since it was opened. Each field is written by one thread."""

    sent: int = 0
    received: int = 0
    """Data frames from others."""
    retries: int = 0
    """Times that a frame found the kernel's queue full (ENOBUFS)."""
    superseded: int = 0
    """Commands that a newer one replaced before they could leave."""
    stale: int = 0
    """Commands that were too old to be sent when the queue took frames again, and were dropped."""
    overruns: int = 0
    """Frames that found the outgoing queue full, and commands replaced although none had left for 60 ms."""
    driver_errors: int = 0
    """Times that the driver failed to send or to receive."""
    bus_errors: int = 0
    """Frames by which the controller reports errors on the bus."""
    unreadable: int = 0
    """Frames whose handling failed."""


class Burst:
    """Detects `count` events within 0.2 s."""

    WINDOW = 0.2  # s

    def __init__(self, count: int) -> None:
        """Begin without an event."""
        self._times: deque[float] = deque(maxlen=count)
        self.rate = count / self.WINDOW
        """Events a second from which on they are a burst."""

    def add(self, now: float) -> bool:
        """One more event, s on any clock; True if it is the last of a burst."""
        self._times.append(now)
        return len(self._times) == self._times.maxlen and now - self._times[0] <= self.WINDOW


_LINUX_ERRORS = frozenset({"socketcan", "socketcand", "gs_usb", "virtual", "udp_multicast"})
"""Interfaces whose error frames have the bits of linux/can/error.h."""
_ERROR_CLASSES = (
    (0x001, "transmit timeout"),
    (0x008, "protocol violation"),
    (0x010, "transceiver error"),
    (0x020, "no acknowledgement on transmission"),
    (0x080, "bus error"),
)
_CONTROLLER = 0x004  # CAN_ERR_CRTL: byte 1 says what
_CONTROLLER_STATES = (
    (0x01, "controller's receive buffer overflowed"),
    (0x30, "controller is error-passive"),
    (0x0C, "many errors"),
)
_HARMLESS = 0x002 | _CONTROLLER | 0x200  # lost arbitration, which is normal, and bare counters


def read_error_frame(interface: str, arbitration_id: int, data: bytes) -> tuple[BusEvent, str] | None:
    """Return what an error frame says; None: nothing that matters."""
    if interface not in _LINUX_ERRORS:
        return BusEvent.ERROR, "error frame"
    if arbitration_id & 0x140:  # CAN_ERR_BUSOFF, CAN_ERR_RESTARTED
        return BusEvent.DOWN, "bus-off" if arbitration_id & 0x040 else "controller restarted after bus-off"
    state = data[1] if arbitration_id & _CONTROLLER and len(data) > 1 else 0
    if state & 0x02:
        return BusEvent.TX_FULL, "controller's transmit buffer overflowed"
    texts = [text for bit, text in _ERROR_CLASSES if arbitration_id & bit]
    texts += [text for bits, text in _CONTROLLER_STATES if state & bits]
    if not texts and arbitration_id & 0x7FF & ~_HARMLESS:
        texts.append("error frame of an unknown class")
    return (BusEvent.ERROR, ", ".join(texts)) if texts else None


class Outbox:
    """Queue of frames from the thread that wants them sent to the thread that sends them.

    Frames leave in order of arrival. A frame with a key (a motor's MIT command) replaces an unsent one with that key
    and takes its place: once the bus is free again the newest command leaves at once, and not behind a queue of old
    ones, which is what a DAMP after a jam needs. A frame with a lifetime is dropped once that is over: nobody may have
    renewed it, because the whole process was stopped, and the robot is elsewhere by now.
    """

    CAPACITY = 256  # frames
    PATIENCE = 0.06
    """s that a motor's commands may be replaced unsent before that counts as an overrun. Less is a late thread; more
    comes close to the motors' CAN timeout."""

    def __init__(self, counters: ChannelCounters, clock: Callable[[], float] = time.monotonic) -> None:
        """Start empty; `clock` in s."""
        self._counters = counters
        self._clock = clock
        self._ready = threading.Condition()
        self._waiting: dict[Hashable, tuple[float, Frame]] = {}  # by key: until when it may leave, and the frame
        self._jammed_since: dict[Hashable, float] = {}
        self._serial = 0
        self.is_closed = False

    def put(self, frames: Sequence[tuple[Hashable, Frame]], lifetime: float = math.inf) -> None:
        """Queue keyed frames for `lifetime` s at most; a key None keeps a frame apart. Never blocks on the bus."""
        until = self._clock() + lifetime
        with self._ready:
            for given, frame in frames:
                key = given
                if key is None:
                    self._serial += 1
                    key = (Outbox, self._serial)
                if key in self._waiting:
                    self._count_replaced(key)
                elif self.is_closed or len(self._waiting) >= self.CAPACITY:
                    self._counters.overruns += 1
                    continue
                self._waiting[key] = until, frame  # a replaced frame keeps its place: a dict remembers the first
            self._ready.notify()

    def _count_replaced(self, key: Hashable) -> None:
        now = self._clock()
        self._counters.superseded += 1
        if now - self._jammed_since.setdefault(key, now) > self.PATIENCE:
            self._counters.overruns += 1

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
                self._counters.stale += 1
            return None

    def sent(self, key: Hashable) -> None:
        """Note that a frame from `take` has left."""
        if key in self._jammed_since:
            with self._ready:
                self._jammed_since.pop(key, None)

    def give_back(self, key: Hashable, frame: Frame, until: float) -> None:
        """Put a frame that could not be sent back in front, unless a newer one with its key has come."""
        with self._ready:
            if key in self._waiting:
                self._count_replaced(key)
            elif not self.is_closed:
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


_POLL = 0.05  # s that a thread waits before it looks whether the channel closes
_RETRY = 0.001  # s until a frame is tried again that the kernel's queue had no room for; 7 frames leave in that time
_SEND_TIMEOUT = 0.005  # s that a driver may wait for room by itself
_TOLERATED = 10  # failures in a row without an error number after which the bus counts as down
_BURST = 10  # bus errors within 0.2 s
_JOIN = 1.0  # s that closing waits for a thread; a driver stuck in the kernel must not keep a robot from being closed
_LONGEST_DELAY = 10.0  # s, beyond any receive timeout: an older frame, after a suspended process, counts as so old
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
        patience: float = 0.016,
    ) -> None:
        """Open the bus and start receiving. Raises `RobotError` if the bus cannot be opened.

        Args:
            receive: is given every data frame, on the receiver's thread.
            clock: the robot's clock, s.
            patience: s in which the queue must be empty again after the driver has refused a frame for want of room;
                a little less than a control period, so that the next tick knows.
        """
        self.address = address
        self.counters = ChannelCounters()
        self._receive_frame = receive
        self._clock = clock
        self._down = ""
        self._latest: dict[BusEvent, Note] = {}
        self._outbox = Outbox(self.counters, clock)
        self._patience = patience
        self._refused_since = math.inf
        self._burst = Burst(_BURST)
        self._echoes = Echoes(address.interface, 2 * Outbox.CAPACITY)
        self._failures = {"receiving": 0, "sending": 0}  # in a row
        self._overruns_seen = 0
        self._closing = threading.Event()
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
        """Return why nothing can be sent or received, or empty. Stays until the channel is opened afresh."""
        for thread in self._threads:
            if not thread.is_alive() and not self._closing.is_set():
                return f"thread '{thread.name}' has ended"
        return self._down

    def recent(self, event: BusEvent, since: float) -> str:
        """Return what the latest event of a kind was, if it happened at or after `since` (s, robot's clock)."""
        note = self._latest.get(event, NEVER)
        return note.text if note.time >= since else ""

    def send(self, frames: Sequence[tuple[Hashable, Frame]], lifetime: float = math.inf) -> None:
        """Queue frames, each with its key or None, see `Outbox`; returns at once. `lifetime` in s."""
        self._outbox.put(frames, lifetime)
        if self.counters.overruns != self._overruns_seen:
            self._overruns_seen = self.counters.overruns
            self._note(BusEvent.TX_FULL, "commands do not leave in time")

    def forget_queue(self) -> None:
        """Drop frames that wait to be sent; one that the driver has at this moment may still leave."""
        self._outbox.clear()

    def flush(self, timeout: float) -> bool:
        """Wait until everything queued was handed to the driver, at most `timeout` s; True if it was."""
        deadline = time.monotonic() + timeout
        while not self._outbox.is_empty and time.monotonic() < deadline:
            time.sleep(_RETRY)
        return self._outbox.is_empty

    def close(self) -> None:
        """Send what waits, stop both threads and close the bus. May be called twice; never raises."""
        if self._closing.is_set():
            return
        self.flush(0.2)
        self._closing.set()
        self._outbox.close()
        for thread in self._threads:
            thread.join(_JOIN)
        try:
            self._bus.shutdown()
        except Exception as error:  # a driver that is gone cannot be shut down either
            self._note(BusEvent.DOWN, f"cannot be closed: {error}")

    def _note(self, event: BusEvent, text: str) -> None:
        self._latest[event] = Note(self._clock(), text)
        if event is BusEvent.DOWN and not self._down:
            self._down = text
        if event is BusEvent.ERROR and self._burst.add(self._clock()):
            # Its own words: the latest error would change in every tick.
            self._latest[BusEvent.BURST] = Note(self._clock(), f"more than {self._burst.rate:g} bus errors a second")

    def _failed(self, what: str, number: int | None, error: Exception, event: BusEvent) -> None:
        """Note a failure of the driver: `event`, or that the bus is down."""
        self.counters.driver_errors += 1
        self._failures[what] += 1
        is_down = number in _DOWN or self._failures[what] >= _TOLERATED
        self._note(BusEvent.DOWN if is_down else event, f"{what} fails: {error}")

    # --- receiver

    def _receive(self) -> None:
        while not self._closing.is_set():
            try:
                message = self._bus.recv(_POLL)
            except Exception as error:
                self._failed("receiving", error_number(error), error, BusEvent.ERROR)
                self._closing.wait(_SEND_TIMEOUT)
                continue
            if message is None:
                continue
            self._failures["receiving"] = 0
            try:
                self._take(message)
            except Exception as error:
                self.counters.unreadable += 1
                self._note(BusEvent.UNREADABLE, f"frame not understood: {type(error).__name__}: {error}")

    def _take(self, message: can.Message) -> None:
        if message.is_error_frame:
            found = read_error_frame(self.address.interface, message.arbitration_id, bytes(message.data))
            if found is not None:
                self.counters.bus_errors += 1
                self._note(*found)
            return
        # Whether `is_rx` does not matter: what another process of this machine sends on SocketCAN comes without it, and
        # what this one sends does not come back.
        if message.is_fd or len(message.data) > 8:
            return
        frame = frame_of(message)
        if not self._echoes.take(frame):
            self.counters.received += 1
            self._receive_frame(frame, self._arrival(message.timestamp))

    def _arrival(self, stamp: float) -> float:
        """Return the time of arrival on the robot's clock.

        Where the driver stamps frames, a frame that lay in the kernel while this process was not running is as old as
        it is, and not as young as its reading.
        """
        now = self._clock()
        if self.address.interface not in _REAL_TIME_STAMPS or stamp <= 0.0:
            return now
        return now - min(max(time.time() - stamp, 0.0), _LONGEST_DELAY)

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
                if self._is_refused(error) and not self._closing.is_set():
                    self._outbox.give_back(key, frame, until)
                    self._closing.wait(_RETRY)
            else:
                self.counters.sent += 1
                self._failures["sending"] = 0
                self._outbox.sent(key)
                if self._outbox.is_empty:
                    self._refused_since = math.inf

    def _is_refused(self, error: Exception) -> bool:
        """Take note of a failure to send; True if there was no room, so that the frame is worth another attempt."""
        number = error_number(error)
        # python-can reports a full buffer with an error number, with a timeout of its own, or with a text only.
        if number in _FULL or isinstance(error, can.CanTimeoutError) or "buffer full" in str(error):
            self.counters.retries += 1
            now = self._clock()
            self._refused_since = min(self._refused_since, now)
            if now - self._refused_since >= self._patience:
                self._note(BusEvent.TX_FULL, f"outgoing queue is full: {error}")
            return True
        # The frame is dropped: what cannot leave now must not leave later, when newer commands have been sent.
        self._failed("sending", number, error, BusEvent.TX_FULL)
        return False
