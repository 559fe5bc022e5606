"""CAN channels on python-can: addresses, frames, locks, and a receiver and a sender thread for each channel."""

from __future__ import annotations

import contextlib
import errno
import functools
import logging
import math
import os
import re
import socket
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import can
from can.interfaces.udp_multicast import UdpMulticastBus

from humanoid_sim.errors import InputError, RobotError, reason_of, require_known
from humanoid_sim.hardware.checks import CheckList

BITRATE = 1_000_000  # bit/s, the motors' default

# python-can logs what it then raises; without a handler of its own that would be printed beside our one line.
logging.getLogger("can").addHandler(logging.NullHandler())


# --- frames


@dataclass(frozen=True, slots=True)
class Frame:
    """One CAN frame, sent or received."""

    arbitration_id: int  # 29 bits, or 11 where `is_extended` is false; without SocketCAN's flag bits
    data: bytes  # 0 to 8 bytes
    is_extended: bool = True  # the IDE bit: an identifier does not tell, motor 1's device-id reply is an extended 0x1FE
    is_remote: bool = False
    is_error: bool = False


def frame_of(message: can.Message) -> Frame:
    """Return the frame that python-can received; some senders leave NumPy's integers in it."""
    identifier = int(message.arbitration_id)
    return Frame(identifier, bytes(message.data), message.is_extended_id, message.is_remote_frame)


def message_of(frame: Frame, timestamp: float = 0.0) -> can.Message:
    """Return a frame for python-can; `timestamp` in s, of the system's wall clock."""
    flags = frame.is_extended, frame.is_remote, frame.is_error
    return can.Message(timestamp, frame.arbitration_id, *flags, data=frame.data)


# --- addresses


@dataclass(frozen=True, slots=True)
class BusAddress:
    """One channel of one of python-can's interfaces."""

    interface: str  # python-can's name of the driver: `socketcan`, `virtual`, `udp_multicast`, `slcan`, …
    channel: str  # for that driver: `can0`, `239.74.163.2`, `/dev/ttyACM0`, …

    def __str__(self) -> str:
        return self.channel if self.interface == "socketcan" else f"{self.interface}:{self.channel}"


_CHANNEL_NAMES = {
    "socketcan": r"[^\s/]{1,15}",  # IFNAMSIZ of the kernel
    "udp_multicast": r"(22[4-9]|23\d)(\.(\d{1,2}|1\d\d|2[0-4]\d|25[0-5])){3}|[fF]{2}[\da-fA-F]{2}:[\da-fA-F:]+",
}


def parse_address(text: str) -> BusAddress:
    """Return the channel of `can0` or `udp_multicast:239.74.163.2`; what follows the first colon is python-can's."""
    interface, colon, channel = text.strip().partition(":")
    if not colon:
        interface, channel = "socketcan", interface
    if not interface or not re.fullmatch(_CHANNEL_NAMES.get(interface, ".+"), channel):
        accepted = "a network interface such as can0, slcan:/dev/ttyACM0, udp_multicast:239.74.163.2 and the like"
        raise InputError(f"bus: is '{text}', expected {accepted}")
    require_known("interface", (interface,), sorted(can.VALID_INTERFACES), f"bus '{text}': ")
    return BusAddress(interface, channel)


def parse_addresses(text: str) -> tuple[BusAddress, ...]:
    """Return the channels of a list such as `can0,can1`, in the order of the robot's buses."""
    addresses = tuple(parse_address(part) for part in text.split(","))
    if len(set(addresses)) < len(addresses):
        raise InputError(f"buses '{text}': a channel is named twice; one channel carries all motors by itself")
    return addresses


# --- opening

_WITHOUT_BITRATE = frozenset({"socketcan", "virtual", "socketcand"})  # none, or given elsewhere
DEVICE_REMEDIES = {  # of a serial port, by the number of the system's error
    errno.ENOENT: "there is no such device: see `ls /dev/serial/by-id`",
    errno.EACCES: "this user may not: sudo usermod -aG dialout $USER, then log in again",
    errno.EBUSY: "another program has it open",
}
_REMEDIES = {
    **DEVICE_REMEDIES,
    errno.ENETDOWN: f"it is down: sudo ip link set {{}} up type can bitrate {BITRATE} restart-ms 0",
    errno.ENODEV: "there is no such network interface: see `ip link`; one may be slcan:/dev/ttyACM0 instead",
    errno.EAFNOSUPPORT: "this kernel has no SocketCAN: sudo modprobe can_raw",
}
_NO_DRIVER = (can.CanInterfaceNotImplementedError, ImportError, NameError)
_IP_MULTICAST_ALL = 49  # linux/in.h; Python's socket module does not name it
_MOST_ECHOES = 1024  # frames that are remembered until they come back: some get lost


class _MulticastBus(UdpMulticastBus):
    """A group without the frames that this end sent, and without those of other groups, which Linux hands over."""

    def __init__(self, group: str) -> None:
        super().__init__(group)
        self._sent: deque[tuple[int, bytes]] = deque(maxlen=_MOST_ECHOES)
        with contextlib.suppress(OSError), socket.socket(fileno=os.dup(self.fileno())) as own:
            own.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._sent.append((msg.arbitration_id, bytes(msg.data)))
        super().send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        message, is_filtered = super()._recv_internal(timeout)
        while message is not None and (message.arbitration_id, bytes(message.data)) in self._sent:
            self._sent.remove((message.arbitration_id, bytes(message.data)))
            message, is_filtered = super()._recv_internal(0.0)
        return message, is_filtered


def open_bus(address: BusAddress) -> can.BusABC:
    """Return an open bus; a `RobotError` of one line with the reason where it cannot be opened."""
    options: dict[str, Any] = {} if address.interface in _WITHOUT_BITRATE else {"bitrate": BITRATE}
    try:
        if address.interface == "udp_multicast":
            return _MulticastBus(address.channel)
        return can.Bus(interface=address.interface, channel=address.channel, **options)
    except Exception as error:  # every driver has exceptions of its own
        reason = f"{type(error).__name__}: {reason_of(error)}"
        number = error_number(error)
        if number == errno.ENODEV and address.interface == "udp_multicast":
            reason = "no network leads there: sudo ip link set lo up; sudo ip route add 224.0.0.0/4 dev lo"
        elif remedy := _REMEDIES.get(number):
            reason = remedy.format(address.channel)
        elif isinstance(error, _NO_DRIVER) or (isinstance(error, OSError) and not number):  # a library of the vendor
            reason += f": pip install 'python-can[{address.interface}]', or its network interface where Linux has one"
        raise RobotError(f"{address}: cannot be opened: {reason}") from error


OpenBus = Callable[[BusAddress], can.BusABC]


def error_number(error: BaseException | None) -> int:
    """Return the `errno` behind one of python-can's exceptions, which keeps it in one of three places; 0 without."""
    while error is not None:
        for name in ("error_code", "errno"):
            number = getattr(error, name, None)
            if isinstance(number, int):
                return number
        error = error.__cause__
    return 0


def lock_channel(address: BusAddress) -> socket.socket:
    """Hold a channel until the socket is closed, also a child's copy; a `RobotError` where another session has it."""
    name = f"{address} {os.getpid()}" if address.interface == "virtual" else str(address)
    lock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        lock.bind(f"\0humanoid_sim {name}"[:100])  # an abstract name of Linux: no file, and one holder
    except OSError:
        lock.close()
        raise RobotError(f"{address}: is in use by another session") from None
    return lock


# --- one channel


class Note(NamedTuple):
    """An event and when it happened."""

    time: float  # s, robot's clock
    text: str


NEVER = Note(-math.inf, "")
STRANGERS = "another program, or a motor in another protocol"


class _Waiting(NamedTuple):
    """A frame that has not left."""

    since: float  # s, when the first frame with its key began to wait
    until: float  # s, after which it must not leave
    frame: Frame


_CAPACITY = 256  # frames that wait to be sent
_LATE = 0.08  # s that a key may wait for the driver; less is a late thread, more comes close to a CAN timeout
_REFUSED = 0.016  # s that a key may wait for a full queue: less than a control period, so that the next tick knows
_POLL = 0.05  # s that a thread waits before it checks whether the channel closes
_RETRY = 0.001  # s until a frame is tried again that the kernel's queue had no room for; 7 frames leave in that time
_SEND_TIMEOUT = 0.005  # s that a driver may wait for room by itself
_JOIN = 1.0  # s that closing waits for a thread; a driver stuck in the kernel must not keep a robot from being closed
_DOWN = frozenset(
    {errno.ENETDOWN, errno.ENODEV, errno.ENXIO, errno.EBADF, errno.ENETUNREACH, errno.EIO, errno.ESHUTDOWN, errno.EPIPE}
)
_FULL = frozenset({errno.ENOBUFS, errno.EAGAIN, errno.EWOULDBLOCK})
_WALL_CLOCK_STAMPS = frozenset({"socketcan", "virtual", "udp_multicast"})  # others count from anywhere


class Channel:
    """A channel that is open for this process alone, with its two threads; the control thread never waits for them.

    Frames leave in order of arrival. One with a key (a motor's MIT command) replaces an unsent one with that key and
    takes its place: after a jam the newest command leaves at once. One with a lifetime is dropped once that is over.
    Nothing here raises once the channel is open: what the driver throws becomes a safety flag.
    """

    def __init__(
        self,
        address: BusAddress,
        receive: Callable[[Frame, float], None],  # takes a frame and its arrival, s, on the receiver's thread
        *,
        open_bus: OpenBus = open_bus,
        clock: Callable[[], float] = time.monotonic,  # the robot's, s
    ) -> None:
        self.address = address
        self.sent = self.received = 0  # data frames since the channel was opened
        self.errors = 0  # failures of the driver, and error frames
        self.down = ""  # why nothing can be sent or received; stays until the channel is opened again
        self.tx_full = NEVER  # the latest sign that frames do not leave as fast as they come
        self.error = ""  # the latest failure that CAN or the driver got over
        self.intruder = NEVER  # the latest sign of another host that commands our motors
        self.strangers = Counter[str]()  # frames that concern none of our motors, by kind
        self.lock = lock_channel(address)  # a child that sends too holds a copy
        self._receive_frame, self._clock = receive, clock
        self._has_stamps = address.interface in _WALL_CLOCK_STAMPS
        self._ready = threading.Condition()
        self._waiting: dict[Hashable, _Waiting] = {}  # a dict keeps the place of a key whose value is replaced
        self._closing = threading.Event()
        try:
            self._bus = open_bus(address)
        except RobotError:
            self.lock.close()
            raise
        # Daemons: a driver that never returns must not keep the process, and with it the motors' commands, alive.
        self._threads = [
            threading.Thread(target=target, name=f"{address} {name}", daemon=True)
            for name, target in (("receiver", self._receive), ("sender", self._send))
        ]
        for thread in self._threads:
            thread.start()

    def send(self, frames: Iterable[tuple[Hashable, Frame]], lifetime: float = math.inf) -> None:
        """Queue frames, each with its key, or None to keep it apart; returns at once. `lifetime` in s."""
        now = self._clock()
        with self._ready:
            for given, frame in frames:
                key = object() if given is None else given
                old = self._waiting.get(key)
                is_full = old is None and len(self._waiting) >= _CAPACITY
                since = now if old is None else old.since
                if is_full or now - since > _LATE:
                    self.tx_full = Note(now, "commands do not leave in time")
                if not is_full:
                    self._waiting[key] = _Waiting(since, now + lifetime, frame)
            self._ready.notify()

    def forget_queue(self) -> None:
        """Drop frames that wait; one that the driver has at this moment may still leave."""
        with self._ready:
            self._waiting.clear()

    def flush(self, timeout: float) -> bool:
        """Wait until everything queued was handed to the driver, at most `timeout` s; True if it was."""
        deadline = time.monotonic() + timeout
        while self._waiting and time.monotonic() < deadline:
            time.sleep(_RETRY)
        return not self._waiting

    def troubles(self) -> tuple[str, ...]:
        """Return why nothing may come back, the most telling first."""
        strangers = [f"{count} × {kind}: {STRANGERS}" for kind, count in self.strangers.items()]
        return tuple(filter(None, [self.down, self.intruder.text, self.tx_full.text, self.error, *strangers]))

    def close(self) -> None:
        """Send what waits, stop both threads and close the bus. May be called twice; never raises."""
        if self._closing.is_set():
            return
        self.flush(0.2)
        self._closing.set()
        for thread in self._threads:
            thread.join(_JOIN)
        with contextlib.suppress(Exception):  # a driver that is gone cannot be shut down either
            self._bus.shutdown()
        self.lock.close()

    # --- receiver

    def _receive(self) -> None:
        while not self._closing.is_set():
            try:
                message = self._bus.recv(_POLL)
            except Exception as error:
                self._failed(f"receiving fails: {error}", error)
                self._closing.wait(_SEND_TIMEOUT)
                continue
            # `is_rx` does not matter: on SocketCAN it lacks for frames of this machine's other processes.
            if message is None:
                continue
            if message.is_fd:
                self.strangers["CAN FD frame"] += 1
            elif message.is_error_frame:
                self._take_error(message.arbitration_id)
            else:
                self.received += 1
                age = max(time.time() - message.timestamp, 0.0) if self._has_stamps else 0.0  # it lay in the kernel
                self._receive_frame(frame_of(message), self._clock() - age)

    def _take_error(self, bits: int) -> None:
        """Take an error frame; the bits are those of linux/can/error.h."""
        self.errors += 1
        if bits & 0x140:  # CAN_ERR_BUSOFF, CAN_ERR_RESTARTED
            self.down = self.down or "bus-off"
        else:
            self.error = "no acknowledgement on transmission" if bits & 0x020 else "bus error"

    def _failed(self, text: str, error: Exception) -> None:
        self.errors += 1
        self.error = text
        if error_number(error) in _DOWN:
            self.down = self.down or text

    # --- sender

    def _send(self) -> None:
        while self._waiting or not self._closing.is_set():
            with self._ready:
                if not self._waiting:
                    self._ready.wait(_POLL)
                key = next(iter(self._waiting), None)
                if key is None:
                    continue
                waiting = self._waiting.pop(key)
            try:
                if self._clock() <= waiting.until:
                    self._bus.send(message_of(waiting.frame), _SEND_TIMEOUT)
                    self.sent += 1
            except Exception as error:
                self._refused(key, waiting, error)

    def _refused(self, key: Hashable, waiting: _Waiting, error: Exception) -> None:
        """Keep a frame for which there is no room; drop one that failed, as newer ones will have been sent later."""
        now = self._clock()
        is_full = error_number(error) in _FULL or isinstance(error, can.CanTimeoutError) or "buffer full" in str(error)
        if not is_full:
            self._failed(f"sending fails: {error}", error)
        if not self.down and (not is_full or now - waiting.since >= _REFUSED):
            self.tx_full = Note(now, f"commands do not leave: {error}")
        if not is_full or self._closing.is_set():
            return
        with self._ready:
            if key in self._waiting:
                self._waiting[key] = self._waiting[key]._replace(since=waiting.since)
            else:
                self._waiting = {key: waiting, **self._waiting}
        self._closing.wait(_RETRY)


# --- the channels of a robot or of a tool

Listener = Callable[[int, Frame, float], bool]
"""Takes a frame with its channel's index and its time (s, robot's clock), on the receiver's thread; True if it knows
the frame, which is then nobody else's."""


class OpenChannels:
    """Channels that are open; a frame goes to the first listener that knows it."""

    def __init__(
        self,
        addresses: Sequence[BusAddress],
        checks: CheckList,
        *,
        clock: Callable[[], float] = time.monotonic,
        open_bus: OpenBus = open_bus,
    ) -> None:
        """Open every channel, or none, with a `RobotError` of everything that is wrong, also before in `checks`."""
        self.clock = clock
        self.listeners: list[Listener] = []  # in the order in which a frame is offered to them
        self.sources = tuple(map(str, addresses))
        self.channels: tuple[Channel, ...] = ()
        for index, address in enumerate(addresses):
            receive = functools.partial(self._receive, index)
            with checks.collecting(address):
                self.channels = (*self.channels, Channel(address, receive, open_bus=open_bus, clock=clock))
        if checks.problems:
            self.close()
            checks.refuse()

    def _receive(self, channel: int, frame: Frame, when: float) -> None:
        any(listener(channel, frame, when) for listener in self.listeners)

    def check(self, checks: CheckList) -> None:
        """Report another master, and each channel that is down, as a problem."""
        for source, channel in zip(self.sources, self.channels, strict=True):
            if channel.intruder is not NEVER:
                checks.problem(source, f"another master drives these motors: {channel.intruder.text}")
            if channel.down:
                checks.problem(source, f"down: {channel.down}")

    def forget_queues(self) -> None:
        """Drop frames that wait to be sent: after a jam, a stop must not stand behind them."""
        for channel in self.channels:
            channel.forget_queue()

    def close(self) -> None:
        for channel in self.channels:
            channel.close()
