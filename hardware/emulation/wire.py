"""Bus time: how long a frame occupies a CAN bus, and which of several waiting frames goes next.

Classical CAN as in ISO 11898-1: a stuff bit after five equal bits from the start of frame to the end of the checksum,
and arbitration in which the frame wins that sends a dominant bit (0) where the other sends a recessive one.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from humanoid_sim.hardware.robstride.frames import Frame

__all__ = ["HOST", "OTHER_HOST", "Transmission", "Wire", "arbitration_key", "frame_bits"]

HOST = -1
"""The node that is no motor: the computer on the bus."""
OTHER_HOST = -2
"""Another one."""

_CRC_POLYNOMIAL = 0x4599
_CRC_BITS = 15
_TAIL_BITS = 13
"""Checksum delimiter 1, acknowledgement 2, end of frame 7, space between frames 3: none of them is stuffed."""
_ERROR_FRAME_BITS = 23
"""Superposed error flags 12, delimiter 8, space between frames 3."""
_STUFF_AFTER = 5


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

    131 to 160 for the extended frames of 8 bytes that the motors use.
    """
    if frame.is_error:
        return _ERROR_FRAME_BITS
    data = b"" if frame.is_remote else frame.data
    arbitration = frame.arbitration_id
    if frame.is_extended:
        # start 1 | base id 11 | SRR, IDE 2 | id extension 18 | RTR 1 | r1, r0 2 | length 4
        header = (arbitration >> 18) << 27 | 0b11 << 25 | (arbitration & 0x3FFFF) << 7 | frame.is_remote << 6
        length = 39
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
    """The bits that decide, as a number: of several frames the least wins. Error frames win over all."""
    if frame.is_error:
        return -1
    arbitration = frame.arbitration_id
    if frame.is_extended:  # base id | SRR 1 | IDE 1 | id extension | RTR
        return (arbitration >> 18) << 21 | 0b11 << 19 | (arbitration & 0x3FFFF) << 1 | frame.is_remote
    return arbitration << 21 | frame.is_remote << 20  # base id | RTR | IDE 0


@dataclass(frozen=True, slots=True)
class Transmission:
    """A frame that has been on the bus."""

    time: float
    """s, when the bus was free again, every receiver having taken the frame."""
    node: int
    """Who sent it: `HOST`, `OTHER_HOST`, or a motor's index."""
    frame: Frame


class Wire:
    """One bus: nodes with frames to send, one frame on the bus at a time.

    A node sends its own frames in the order in which they were submitted, as a driver's queue does; between nodes the
    least `arbitration_key` wins. Times never go back; events are taken one by one with `next_time` and `step`.
    """

    def __init__(self, bitrate: float) -> None:
        """Free bus; `bitrate` in bit/s, 0 for a bus on which nothing takes time and frames keep their order."""
        self._bit_time = 1.0 / bitrate if bitrate else 0.0
        self._waiting: dict[int, deque[tuple[float, int, Frame]]] = {}
        # by node: when a frame is ready, its arbitration key, the frame
        self._current: tuple[float, int, Frame] | None = None
        self._free_at = -math.inf
        self.busy = 0.0
        """s for which the bus has been occupied."""
        self.frames = 0
        """Frames that have been sent."""

    def submit(self, node: int, frame: Frame, time: float) -> None:
        """Queue a frame that is ready to be sent at `time`, s."""
        self._waiting.setdefault(node, deque()).append((time, arbitration_key(frame), frame))

    def waiting(self, node: int) -> int:
        """Frames of a node that are not yet on the bus."""
        queue = self._waiting.get(node)
        return len(queue) if queue else 0

    def clear(self) -> None:
        """Forget every frame that has not been received."""
        self._waiting.clear()
        self._current = None

    @property
    def next_time(self) -> float:
        """s, when something happens next: a frame begins or ends. Infinity: nothing is waiting."""
        if self._current is not None:
            return self._current[0]
        ready = min((queue[0][0] for queue in self._waiting.values()), default=math.inf)
        return max(ready, self._free_at)

    def step(self) -> Transmission | None:
        """Take the event at `next_time`: the frame that has ended there, or None if one begins."""
        if self._current is not None:
            time, node, frame = self._current
            self._current, self._free_at = None, time
            self.frames += 1
            return Transmission(time, node, frame)
        now = self.next_time
        ready = [(queue[0], node) for node, queue in self._waiting.items() if queue[0][0] <= now]
        if self._bit_time:
            (_, _, frame), node = min(ready, key=lambda entry: (entry[0][1], entry[1]))
        else:
            (_, _, frame), node = min(ready, key=lambda entry: entry[0][0])
        queue = self._waiting[node]
        queue.popleft()
        if not queue:
            del self._waiting[node]
        duration = frame_bits(frame) * self._bit_time if self._bit_time else 0.0
        self.busy += duration
        self._current = now + duration, node, frame
        return None
