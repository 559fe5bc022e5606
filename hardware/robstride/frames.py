"""CAN frames as plain data, and the fields of the protocol's 29-bit identifier."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

__all__ = ["BROADCAST_ID", "DATA_LENGTH", "FrameType", "Identifier", "join_identifier", "split_identifier"]

BROADCAST_ID = 0xFE
"""Destination of a device-id reply."""
DATA_LENGTH = 8
"""Bytes in every frame that carries data."""


class FrameType(IntEnum):
    """Communication type, bits 28..24 of the identifier. 5, 8 to 16, 19, 20 and 26 to 31 are not defined."""

    GET_DEVICE_ID = 0
    OPERATION_CONTROL = 1
    STATUS = 2
    ENABLE = 3
    STOP = 4
    """Stop, clear faults and read the version, told apart by the data."""
    SET_ZERO = 6
    SET_DEVICE_ID = 7
    READ_PARAMETER = 17
    WRITE_PARAMETER = 18
    FAULT_REPORT = 21
    SAVE_PARAMETERS = 22
    SET_BAUD_RATE = 23
    ACTIVE_REPORT = 24
    SET_PROTOCOL = 25


class Identifier(NamedTuple):
    """The parts of a 29-bit identifier."""

    type: int
    """Bits 28..24: a `FrameType`, or a number without meaning."""
    high: int
    """Bits 23..16: mode and faults of a status, result of a parameter reply, high byte of an effort, a new id."""
    low: int
    """Bits 15..8: the sender's id, or the low byte of an effort."""
    destination: int
    """Bits 7..0."""


def split_identifier(arbitration_id: int) -> Identifier:
    """The parts of an identifier; never raises."""
    return Identifier(
        arbitration_id >> 24 & 0x1F, arbitration_id >> 16 & 0xFF, arbitration_id >> 8 & 0xFF, arbitration_id & 0xFF
    )


def join_identifier(kind: int, high: int, low: int, destination: int) -> int:
    """The 29-bit identifier with these parts."""
    return kind << 24 | high << 16 | low << 8 | destination
