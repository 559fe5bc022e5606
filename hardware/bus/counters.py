"""What happened on a channel, counted."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["ChannelCounters"]


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
