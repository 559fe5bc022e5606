"""Events on a channel: error frames, read by the bits of Linux' `linux/can/error.h`, foreign frames, counters."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple


class BusEvent(Enum):
    """Meaning of an error on the bus for whoever drives motors over it."""

    DOWN = "down"
    """The controller has left the bus, or the interface is gone: nothing is sent or heard."""
    TX_FULL = "outgoing queue full"
    """Frames do not leave as fast as they come."""
    ERROR = "bus error"
    """A frame was damaged on the wire, or lost in the controller, and nobody can tell whose. CAN sends it again; what
    is lost all the same is missed elsewhere: a joint falls silent, a queue does not empty."""
    BURST = "burst of bus errors"
    """More of them than a bus recovers from unnoticed, see `BurstDetector`."""
    UNREADABLE = "frame not understood"
    """A frame arrived whole, and its handling failed."""
    NORMAL = "normal"
    """Part of a CAN bus's working, worth a count only."""


_LINUX_BITS = frozenset({"socketcan", "socketcand", "gs_usb", "virtual", "udp_multicast"})
_CLASSES = (
    (0x040, BusEvent.DOWN, "bus-off"),
    (0x100, BusEvent.DOWN, "controller restarted after bus-off"),
    (0x001, BusEvent.ERROR, "transmit timeout"),
    (0x008, BusEvent.ERROR, "protocol violation"),
    (0x010, BusEvent.ERROR, "transceiver error"),
    (0x020, BusEvent.ERROR, "no acknowledgement on transmission"),
    (0x080, BusEvent.ERROR, "bus error"),
    (0x002, BusEvent.NORMAL, "arbitration lost"),  # another frame had a lower id, and the controller sends again
)
"""CAN_ERR_BUSOFF, _RESTARTED, _TX_TIMEOUT, _PROT, _TRX, _ACK, _BUSERROR, _LOSTARB."""
_CONTROLLER = 0x004
"""CAN_ERR_CRTL: byte 1 says what."""
_CONTROLLER_STATES = (
    (0x02, BusEvent.TX_FULL, "controller's transmit buffer overflowed"),
    (0x01, BusEvent.ERROR, "controller's receive buffer overflowed"),
    (0x10, BusEvent.ERROR, "controller is error-passive (receiving)"),
    (0x20, BusEvent.ERROR, "controller is error-passive (transmitting)"),
    (0x04, BusEvent.ERROR, "many receive errors"),
    (0x08, BusEvent.ERROR, "many transmit errors"),
    (0x40, BusEvent.NORMAL, "controller is error-active again"),
)
_COUNTERS = 0x200
"""CAN_ERR_CNT: bytes 6 and 7 hold the controller's error counters; no error by itself."""
_BY_WEIGHT = (BusEvent.DOWN, BusEvent.TX_FULL, BusEvent.ERROR, BusEvent.NORMAL)


def read_error_frame(interface: str, arbitration_id: int, data: bytes) -> tuple[BusEvent, tuple[str, ...]]:
    """Return the heaviest event of an error frame, and all in words that never change, so that they can be counted.

    An unknown one counts as a bus error. Many drivers have error frames of their own, in which the bits mean others.
    """
    if interface not in _LINUX_BITS:
        return BusEvent.ERROR, ("error frame",)
    found = [(event, text) for bit, event, text in _CLASSES if arbitration_id & bit]
    if arbitration_id & _CONTROLLER:
        state = data[1] if len(data) > 1 else 0
        found += [(event, text) for bit, event, text in _CONTROLLER_STATES if state & bit] or [
            (BusEvent.ERROR, "controller problem")
        ]
    if not found:
        is_counters_only = arbitration_id & 0x1FFFFFFF == _COUNTERS
        event = BusEvent.NORMAL if is_counters_only else BusEvent.ERROR
        found.append((event, "error counters" if is_counters_only else "error frame of an unknown class"))
    heaviest = min((event for event, _ in found), key=_BY_WEIGHT.index)
    return heaviest, tuple(text for _, text in found)


class BurstDetector:
    """Tells single bus errors, after which CAN sends the frame again, from a bus that is about to fail.

    Or other events from many of them. The limit of errors is 10 within 0.2 s, 50 a second. A plug or a motor that is
    switched gives up to half a dozen: the states that the controller goes through. A controller leaves the bus by
    itself where more than about one in nine of the frames that it sends are damaged, which for 14 motors at 50 Hz is 78
    a second; half of that is left as a margin.
    """

    _WINDOW = 0.2

    def __init__(self, count: int = 10) -> None:
        """Begin without an event; `count` of them are a burst."""
        self._times: deque[float] = deque(maxlen=count)
        self.rate = count / self._WINDOW
        """Events a second from which on they are a burst."""

    def add(self, now: float) -> bool:
        """One more event, s on any clock; whether it is the last of a burst."""
        self._times.append(now)
        return len(self._times) == self._times.maxlen and now - self._times[0] <= self._WINDOW


@dataclass(slots=True)
class ChannelCounters:
    """Counters of a channel since it was opened. Each field is written by one thread."""

    sent: int = 0
    received: int = 0
    """Data frames from others."""
    retries: int = 0
    """Times that a frame found the kernel's queue full (ENOBUFS)."""
    send_errors: int = 0
    """Frames that the driver refused, and that were dropped."""
    stale: int = 0
    """Commands that were too old to be sent when the queue took frames again, and were dropped."""
    receive_errors: int = 0
    """Times that the driver failed to receive."""
    error_frames: int = 0
    """Frames by which the controller reports errors on the bus."""
    error_classes: Counter[str] = field(default_factory=Counter)
    """Errors that these report; one frame may report several."""
    lost_arbitration: int = 0
    """Error frames that report nothing but the bus's normal working."""
    unusable: int = 0
    """CAN FD frames and others that this protocol cannot contain."""
    receiver_failures: int = 0
    """Frames whose handling raised: a bug."""
    superseded: int = 0
    """Commands that a newer one replaced before they could leave."""
    overruns: int = 0
    """Frames that found the outgoing queue full, and commands replaced although none had left for 60 ms."""


class Note(NamedTuple):
    """Something that happened."""

    time: float
    """s, robot's clock."""
    text: str


NEVER = Note(-float("inf"), "")


@dataclass(slots=True)
class ChannelNotes:
    """Records of what was received on one channel and belongs to none of its motors."""

    intruder: Note = NEVER
    """The latest sign of another host that commands our motors."""
    intrusions: int = 0
    strangers: Counter[str] = field(default_factory=Counter)
    """Frames that concern none of our motors, by what they are."""
    flood: Note = NEVER
    """The latest of so many of these that they take two fifths of a bus of 1 Mbit/s."""
    _burst: BurstDetector = field(default_factory=lambda: BurstDetector(600))

    def add_stranger(self, what: str, time: float) -> None:
        """Count a frame that concerns none of our motors, at `time`, s, robot's clock."""
        self.strangers[what] += 1
        if self._burst.add(time):
            text = f"the bus is flooded: more than {self._burst.rate:g} frames a second that concern none of its motors"
            self.flood = Note(time, text)
