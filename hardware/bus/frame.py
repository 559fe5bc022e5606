"""CAN frames as plain data, and as python-can has them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import can

BITRATE = 1_000_000  # bit/s, the motors' default


@dataclass(frozen=True, slots=True)
class Frame:
    """One CAN frame, sent or received."""

    arbitration_id: int  # 29 bits, or 11 where `is_extended` is false; without SocketCAN's flag bits
    data: bytes  # 0 to 8 bytes
    is_extended: bool = True  # the IDE bit: an identifier does not tell, motor 1's device-id reply is an extended 0x1FE
    is_remote: bool = False
    is_error: bool = False


def frame_of(message: can.Message) -> Frame:
    """Return a frame from what python-can received; some senders leave NumPy's integers in it."""
    identifier = int(message.arbitration_id)
    return Frame(identifier, bytes(message.data), message.is_extended_id, message.is_remote_frame)


def message_of(frame: Frame, timestamp: float = 0.0) -> can.Message:
    """Return a frame for python-can; `timestamp` in s, of the system's wall clock."""
    return can.Message(
        timestamp=timestamp,
        arbitration_id=frame.arbitration_id,
        data=frame.data,
        is_extended_id=frame.is_extended,
        is_remote_frame=frame.is_remote,
        is_error_frame=frame.is_error,
    )


class Echoes:
    """A sender's own frames, which come back to it on `udp_multicast`."""

    def __init__(self, interface: str, capacity: int) -> None:
        """Remember at most `capacity` frames: some get lost on the way, and are forgotten."""
        self._has_echoes = interface == "udp_multicast"
        self._sent: deque[tuple[int, bytes]] = deque(maxlen=capacity)

    def expect(self, frame: Frame) -> None:
        """Expect the echo of a frame that is sent."""
        if self._has_echoes:
            self._sent.append((frame.arbitration_id, frame.data))

    def take(self, frame: Frame) -> bool:
        """Return whether a frame is an echo; each is one once."""
        key = frame.arbitration_id, frame.data
        if key not in self._sent:
            return False
        self._sent.remove(key)
        return True
