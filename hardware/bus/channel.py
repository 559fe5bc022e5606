"""One open CAN channel: a thread that receives, a thread that sends, and what went wrong on it.

Nothing here raises once the channel is open: whatever the driver throws becomes an event, which the robot turns into
safety flags. The control thread never touches the driver, and so never waits for the kernel.
"""

from __future__ import annotations

import contextlib
import errno
import math
import threading
import time
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import can

from humanoid_sim.hardware.bus.address import BusAddress, error_number, open_bus
from humanoid_sim.hardware.bus.frame import Echoes, Frame, frame_of, message_of

OpenBus = Callable[[BusAddress], can.BusABC]
Received = Callable[[Frame, float], None]  # takes a frame and its arrival, s, robot's clock; on the receiver's thread


class Note(NamedTuple):
    """An event and when it happened."""

    time: float  # s, robot's clock
    text: str


NEVER = Note(-math.inf, "")


@dataclass(slots=True)
class ChannelCounters:
    """Counters of a channel since it was opened. Each field is written by one thread."""

    sent: int = 0
    received: int = 0  # data frames from others
    superseded: int = 0  # commands that a newer one replaced before they could leave
    stale: int = 0  # commands that were too old to be sent when the queue took frames again, and were dropped
    errors: int = 0  # failures of the driver, and error frames


class _Waiting(NamedTuple):
    since: float  # s, when a frame with this key was first refused or replaced; infinite: not yet
    until: float  # s, after which the frame must not leave
    frame: Frame


class Outbox:
    """Queue of frames from the thread that wants them sent to the thread that sends them.

    Frames leave in order of arrival. A frame with a key (a motor's MIT command) replaces an unsent one with that key
    and takes its place: once the bus is free again the newest command leaves at once, and not behind a queue of old
    ones, which is what a DAMP after a jam needs. A frame with a lifetime is dropped once that is over: nobody may have
    renewed it, because the whole process was stopped, and the robot is elsewhere by now.
    """

    CAPACITY = 256  # frames
    PATIENCE = 0.06  # s that a key may jam; less is a late thread, more comes close to the motors' CAN timeout

    def __init__(self, counters: ChannelCounters, clock: Callable[[], float]) -> None:
        self._counters, self._clock = counters, clock
        self._ready = threading.Condition()
        self._waiting: dict[Hashable, _Waiting] = {}
        self._serial = 0
        self.is_closed = False

    def put(self, frames: Sequence[tuple[Hashable, Frame]], lifetime: float) -> bool:
        """Queue keyed frames for `lifetime` s at most; a key None keeps a frame apart. False: they leave too slowly."""
        now, in_time = self._clock(), True
        with self._ready:
            for given, frame in frames:
                self._serial += 1
                key = (Outbox, self._serial) if given is None else given
                old = self._waiting.get(key)
                if old is None and (self.is_closed or len(self._waiting) >= self.CAPACITY):
                    in_time = False
                    continue
                self._counters.superseded += old is not None
                since = math.inf if old is None else min(old.since, now)
                in_time &= now - since <= self.PATIENCE
                self._waiting[key] = _Waiting(since, now + lifetime, frame)  # in place: a dict remembers the first
            self._ready.notify()
        return in_time

    def take(self, timeout: float) -> tuple[Hashable, _Waiting] | None:
        """Return the next frame with its key, or None if `timeout`, s, passes without."""
        with self._ready:
            if not self._waiting and not self.is_closed:
                self._ready.wait(timeout)
            now = self._clock()
            while self._waiting:
                key = next(iter(self._waiting))
                waiting = self._waiting.pop(key)
                if now <= waiting.until:
                    return key, waiting
                self._counters.stale += 1
            return None

    def give_back(self, key: Hashable, refused: _Waiting) -> None:
        """Put a frame that could not be sent back in front, unless a newer one with its key has come."""
        with self._ready:
            newer = self._waiting.get(key)
            if newer is not None:
                self._counters.superseded += 1
                self._waiting[key] = newer._replace(since=refused.since)
            elif not self.is_closed:
                self._waiting = {key: refused, **self._waiting}

    def clear(self) -> None:
        """Forget everything that waits."""
        with self._ready:
            self._waiting.clear()

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
_PATIENCE = 0.016  # s that a refused frame may wait: less than a control period, so that the next tick knows
_SEND_TIMEOUT = 0.005  # s that a driver may wait for room by itself
_TOLERATED = 10  # failures in a row without an error number after which the bus counts as down
_JOIN = 1.0  # s that closing waits for a thread; a driver stuck in the kernel must not keep a robot from being closed
_LONGEST_DELAY = 10.0  # s, beyond any receive timeout: an older frame, after a suspended process, counts as so old
_DOWN = frozenset(
    {errno.ENETDOWN, errno.ENODEV, errno.ENXIO, errno.EBADF, errno.ENETUNREACH, errno.EIO, errno.ESHUTDOWN, errno.EPIPE}
)
_FULL = frozenset({errno.ENOBUFS, errno.EAGAIN, errno.EWOULDBLOCK})
_REAL_TIME_STAMPS = frozenset({"socketcan", "virtual", "udp_multicast"})  # the system's wall clock; others count anyhow


class Channel:
    """An open channel with its two threads."""

    def __init__(
        self,
        address: BusAddress,
        receive: Received,
        *,
        open_bus: OpenBus = open_bus,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Open the bus and start receiving. Raises `RobotError` if the bus cannot be opened.

        `receive` gets every data frame; `clock`: the robot's, s.
        """
        self.address = address
        self.counters = ChannelCounters()
        self._receive_frame, self._clock = receive, clock
        self.tx_full = NEVER  # the latest sign that frames do not leave as fast as they come
        self.error = NEVER  # the latest damaged frame; CAN sends it again, and a silent joint shows what is lost
        self._down = ""
        self._outbox = Outbox(self.counters, clock)
        self._echoes = Echoes(address.interface, 2 * Outbox.CAPACITY)
        self._failures = {"receiving": 0, "sending": 0}  # in a row
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

    def send(self, frames: Sequence[tuple[Hashable, Frame]], lifetime: float = math.inf) -> None:
        """Queue frames, each with its key or None, see `Outbox`; returns at once. `lifetime` in s."""
        if not self._outbox.put(frames, lifetime):
            self.tx_full = Note(self._clock(), "commands do not leave in time")

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
        with contextlib.suppress(Exception):  # a driver that is gone cannot be shut down either
            self._bus.shutdown()

    def _failed(self, what: str, error: Exception) -> None:
        """Note a failure of the driver, or that the bus is down."""
        self.counters.errors += 1
        self._failures[what] += 1
        note = Note(self._clock(), f"{what} fails: {error}")
        if error_number(error) in _DOWN or self._failures[what] >= _TOLERATED:
            self._down = self._down or note.text
        elif what == "sending":
            self.tx_full = note
        else:
            self.error = note

    # --- receiver

    def _receive(self) -> None:
        while not self._closing.is_set():
            try:
                message = self._bus.recv(_POLL)
            except Exception as error:
                self._failed("receiving", error)
                self._closing.wait(_SEND_TIMEOUT)
                continue
            if message is None:
                continue
            self._failures["receiving"] = 0
            # `is_rx` does not matter: on SocketCAN it lacks for frames of this machine's other processes.
            if message.is_error_frame:
                self._take_error(message.arbitration_id, bytes(message.data))
            elif not message.is_fd and len(message.data) <= 8:
                frame = frame_of(message)
                if not self._echoes.take(frame):
                    self.counters.received += 1
                    self._receive_frame(frame, self._arrival(message.timestamp))

    def _take_error(self, arbitration_id: int, data: bytes) -> None:
        """Take an error frame; the bits are those of linux/can/error.h."""
        self.counters.errors += 1
        if arbitration_id & 0x140:  # CAN_ERR_BUSOFF, CAN_ERR_RESTARTED
            self._down = self._down or "bus-off"
        elif arbitration_id & 0x004 and len(data) > 1 and data[1] & 0x02:  # CAN_ERR_CRTL_TX_OVERFLOW
            self.tx_full = Note(self._clock(), "controller's transmit buffer overflowed")
        elif arbitration_id & 0x0B9:  # lost arbitration and bare counters matter to nobody
            text = "no acknowledgement on transmission" if arbitration_id & 0x020 else "bus error"
            self.error = Note(self._clock(), text)

    def _arrival(self, stamp: float) -> float:
        """Return the time of arrival, s, robot's clock: a frame ages while it lies in the kernel."""
        now = self._clock()
        if self.address.interface not in _REAL_TIME_STAMPS or stamp <= 0.0:
            return now
        return now - min(max(time.time() - stamp, 0.0), _LONGEST_DELAY)

    # --- sender

    def _send(self) -> None:
        while not (self._outbox.is_closed and self._outbox.is_empty):
            item = self._outbox.take(_POLL)
            if item is None:
                continue
            key, waiting = item
            self._echoes.expect(waiting.frame)
            try:
                self._bus.send(message_of(waiting.frame), _SEND_TIMEOUT)
            except Exception as error:
                self._echoes.take(waiting.frame)  # it will not come back
                if not _is_full(error):
                    # Dropped: what cannot leave now must not leave later, when newer commands have been sent.
                    self._failed("sending", error)
                elif not self._closing.is_set():
                    now = self._clock()
                    since = min(waiting.since, now)
                    if now - since >= _PATIENCE:
                        self.tx_full = Note(now, f"outgoing queue is full: {error}")
                    self._outbox.give_back(key, waiting._replace(since=since))
                    self._closing.wait(_RETRY)
            else:
                self.counters.sent += 1
                self._failures["sending"] = 0


def _is_full(error: Exception) -> bool:
    """Return whether a driver has no room: an error number, a timeout of python-can's, or a text only."""
    return error_number(error) in _FULL or isinstance(error, can.CanTimeoutError) or "buffer full" in str(error)
