"""What goes wrong on a channel: error frames, read by the bits of Linux' `linux/can/error.h`, and counters."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

__all__ = ["BusEvent", "ChannelCounters", "ErrorReport", "read_error_frame"]


class BusEvent(Enum):
    """What an error on the bus means for whoever drives motors over it."""

    DOWN = "down"
    """The controller has left the bus, or the interface is gone: nothing is sent or heard."""
    TX_FULL = "outgoing queue full"
    """Frames do not leave as fast as they come."""
    DAMAGED = "damaged frame"
    """Frames are lost or damaged on the wire or in the controller; whose they were cannot be told."""
    NORMAL = "normal"
    """Part of a CAN bus's working, worth a count only."""


@dataclass(frozen=True, slots=True)
class ErrorReport:
    """One error frame, read."""

    event: BusEvent
    text: str


_LINUX_BITS = frozenset({"socketcan", "socketcand", "gs_usb", "virtual", "udp_multicast"})
_CLASSES = (
    (0x040, BusEvent.DOWN, "bus-off"),
    (0x100, BusEvent.DOWN, "controller restarted after bus-off"),
    (0x001, BusEvent.DAMAGED, "transmit timeout"),
    (0x008, BusEvent.DAMAGED, "protocol violation"),
    (0x010, BusEvent.DAMAGED, "transceiver error"),
    (0x020, BusEvent.DAMAGED, "no acknowledgement on transmission"),
    (0x080, BusEvent.DAMAGED, "bus error"),
)
"""CAN_ERR_BUSOFF, _RESTARTED, _TX_TIMEOUT, _PROT, _TRX, _ACK, _BUSERROR."""

_LOST_ARBITRATION = 0x002
"""CAN_ERR_LOSTARB: another frame had a lower id. The controller sends again."""
_CONTROLLER = 0x004
"""CAN_ERR_CRTL: byte 1 says what."""
_CONTROLLER_STATES = (
    (0x02, BusEvent.TX_FULL, "controller's transmit buffer overflowed"),
    (0x01, BusEvent.DAMAGED, "controller's receive buffer overflowed"),
    (0x10, BusEvent.DAMAGED, "controller is error-passive (receiving)"),
    (0x20, BusEvent.DAMAGED, "controller is error-passive (transmitting)"),
    (0x04, BusEvent.DAMAGED, "many receive errors"),
    (0x08, BusEvent.DAMAGED, "many transmit errors"),
    (0x40, BusEvent.NORMAL, "controller is error-active again"),
)
_COUNTERS = 0x200
"""CAN_ERR_CNT: bytes 6 and 7 hold the controller's error counters; no error by itself."""
_BY_WEIGHT = (BusEvent.DOWN, BusEvent.TX_FULL, BusEvent.DAMAGED, BusEvent.NORMAL)


def read_error_frame(interface: str, arbitration_id: int, data: bytes) -> ErrorReport:
    """The heaviest event of an error frame, and all of them in words. An unknown one counts as a damaged frame.

    Args:
        interface: python-can's name of the driver; many have error frames of their own, in which the bits mean others.
        arbitration_id: the frame's, whose bits are error classes.
        data: the frame's.
    """
    if interface not in _LINUX_BITS:
        return ErrorReport(BusEvent.DAMAGED, "error frame")
    found = [(event, text) for bit, event, text in _CLASSES if arbitration_id & bit]
    if arbitration_id & _CONTROLLER:
        state = data[1] if len(data) > 1 else 0
        found += [(event, text) for bit, event, text in _CONTROLLER_STATES if state & bit] or [
            (BusEvent.DAMAGED, "controller problem")
        ]
    if arbitration_id & _LOST_ARBITRATION:
        found.append((BusEvent.NORMAL, "arbitration lost"))
    if not found:
        is_counters_only = arbitration_id & 0x1FFFFFFF == _COUNTERS
        event = BusEvent.NORMAL if is_counters_only else BusEvent.DAMAGED
        found.append((event, "error counters" if is_counters_only else f"error frame 0x{arbitration_id:08X}"))
    heaviest = min((event for event, _ in found), key=_BY_WEIGHT.index)
    return ErrorReport(heaviest, ", ".join(text for _, text in found))


@dataclass(slots=True)
class ChannelCounters:
    """What happened on a channel since it was opened. Each field is written by one thread."""

    sent: int = 0
    received: int = 0
    """Data frames from others."""
    retries: int = 0
    """Times that a frame found the kernel's queue full (ENOBUFS)."""
    send_errors: int = 0
    """Frames that the driver refused, and that were dropped."""
    receive_errors: int = 0
    """Times that the driver failed to receive."""
    error_frames: int = 0
    lost_arbitration: int = 0
    """Error frames that report nothing but the bus's normal working."""
    unusable: int = 0
    """CAN FD frames and others that this protocol cannot contain."""
    receiver_failures: int = 0
    """Frames whose handling raised: a bug, reported as a damaged frame."""
    superseded: int = 0
    """Commands that a newer one replaced before they could leave."""
    overruns: int = 0
    """Frames that found the outgoing queue full, and commands replaced although none had left for 60 ms."""
