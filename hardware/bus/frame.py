"""CAN frames as plain data, and the load that they are for a bus."""

from __future__ import annotations

from dataclasses import dataclass

BITRATE = 1_000_000
"""bit/s, the motors' default."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One CAN frame, sent or received."""

    arbitration_id: int
    """29 bits, or 11 where `is_extended` is false; without SocketCAN's flag bits."""
    data: bytes
    """0 to 8 bytes."""
    is_extended: bool = True
    """The frame's IDE bit. An identifier below 0x800 does not tell: motor 1's device-id reply is 0x1FE and extended."""
    is_remote: bool = False
    is_error: bool = False

    def __str__(self) -> str:
        """As `candump` has it: `0300FD0B#0000000000000000`."""
        return f"{self.arbitration_id:0{8 if self.is_extended else 3}X}#{self.data.hex().upper()}"


FRAME_BITS = 145
"""Bits of an extended frame of 8 bytes, which is what motors speak: 131 without stuff bits, 160 with the most."""


def bus_load(frames_per_second: float) -> float:
    """Get the share of a 1 Mbit/s bus that so many frames of 8 bytes take, to within 10 % of itself: 0 idle, 1 full."""
    return frames_per_second * FRAME_BITS / BITRATE
