"""CAN frames as plain data, and how long one occupies a bus: every figure of a bus's load comes from here.

Classical CAN as in ISO 11898-1: a stuff bit after five equal bits from the start of frame to the end of the checksum,
and arbitration in which the frame wins that sends a dominant bit (0) where the other sends a recessive one.
"""

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


_CRC_POLYNOMIAL = 0x4599
_CRC_BITS = 15
_TAIL_BITS = 13
"""Checksum delimiter 1, acknowledgement 2, end of frame 7, space between frames 3: none of them is stuffed."""
_ERROR_FRAME_BITS = 23
"""Superposed error flags 12, delimiter 8, space between frames 3."""
_STUFF_AFTER = 5
_HEADER_BITS = 39
"""Bits of an extended frame: start 1, identifier 29, SRR, IDE, RTR, r1, r0 5, length 4."""


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte << (_CRC_BITS - 8)
        for _ in range(8):
            crc <<= 1
            if crc >> _CRC_BITS:
                crc ^= (1 << _CRC_BITS) | _CRC_POLYNOMIAL
        table.append(crc)
    return tuple(table)


def _stuffing_table() -> tuple[tuple[tuple[int, int], ...], ...]:
    """By state and byte: the stuff bits that are inserted, and the next state.

    A state is the last bit and the number of equal bits up to it, 1 to 5, as `5·bit + run - 1`. After a run of 5 the
    inserted bit is the opposite one, so that the next bit finds a run of 1 of that.
    """
    table = []
    for state in range(2 * _STUFF_AFTER):
        row = []
        for byte in range(256):
            last, run, stuffed = state // _STUFF_AFTER, state % _STUFF_AFTER + 1, 0
            for shift in range(7, -1, -1):
                if run == _STUFF_AFTER:
                    last, run, stuffed = 1 - last, 1, stuffed + 1
                bit = byte >> shift & 1
                last, run = bit, run + 1 if bit == last else 1
            row.append((stuffed, _STUFF_AFTER * last + run - 1))
        table.append(tuple(row))
    return tuple(table)


_CRC = _crc_table()
_STUFFING = _stuffing_table()
_RECESSIVE_ONCE = _STUFF_AFTER
"""The state after one recessive bit: what the padding before the start of frame leaves behind."""


def frame_bits(frame: Frame) -> int:
    """Bit times from the start of frame to the end of the space after it, stuff bits included.

    `FRAME_BITS` are its limits for the extended frames of 8 bytes that the motors use.
    """
    if frame.is_error:
        return _ERROR_FRAME_BITS
    data = b"" if frame.is_remote else frame.data
    arbitration = frame.arbitration_id
    if frame.is_extended:
        # start 1 | base id 11 | SRR, IDE 2 | id extension 18 | RTR 1 | r1, r0 2 | length 4
        header = (arbitration >> 18) << 27 | 0b11 << 25 | (arbitration & 0x3FFFF) << 7 | frame.is_remote << 6
        length = _HEADER_BITS
    else:
        header = arbitration << 7 | frame.is_remote << 6  # start 1 | id 11 | RTR 1 | IDE, r0 2 | length 4
        length = 19
    header |= len(frame.data)
    head = header.to_bytes(5 if frame.is_extended else 3, "big")  # leading zeros do not count in the checksum
    crc = 0
    for byte in head + data:
        crc = (crc << 8 ^ _CRC[(crc >> (_CRC_BITS - 8) ^ byte) & 0xFF]) & 0x7FFF
    length += 8 * len(data) + _CRC_BITS
    stream = (header << 8 * len(data) | int.from_bytes(data, "big")) << _CRC_BITS | crc
    # Padded to whole bytes with 0101…: no run of the padding reaches into the frame, which starts dominant.
    padding = -length % 8
    stream |= (0b01010101 & (1 << padding) - 1) << length
    state, stuffed = _RECESSIVE_ONCE, 0
    for byte in stream.to_bytes((length + padding) // 8, "big"):
        count, state = _STUFFING[state][byte]
        stuffed += count
    # A run that ends with the checksum's last bit is still followed by its stuff bit.
    stuffed += state % _STUFF_AFTER == _STUFF_AFTER - 1
    return length + stuffed + _TAIL_BITS


def arbitration_key(frame: Frame) -> int:
    """Return the bits that decide, as a number: of several frames the least wins. Error frames win over all."""
    if frame.is_error:
        return -1
    arbitration = frame.arbitration_id
    if frame.is_extended:  # base id | SRR 1 | IDE 1 | id extension | RTR
        return (arbitration >> 18) << 21 | 0b11 << 19 | (arbitration & 0x3FFFF) << 1 | frame.is_remote
    return arbitration << 21 | frame.is_remote << 20  # base id | RTR | IDE 0


_BARE_BITS = _HEADER_BITS + 64 + _CRC_BITS
FRAME_BITS = (_BARE_BITS + _TAIL_BITS, _BARE_BITS + (_BARE_BITS - 1) // (_STUFF_AFTER - 1) + _TAIL_BITS)
"""Bits of an extended frame of 8 bytes, which is what motors speak: without stuff bits, and with the most."""


def bus_load(frames_per_second: float) -> float:
    """Get the share of a 1 Mbit/s bus that so many frames of 8 bytes take, to within 10 % of itself: 0 idle, 1 full."""
    return frames_per_second * 0.5 * sum(FRAME_BITS) / BITRATE
