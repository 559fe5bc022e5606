"""From a MIDI byte stream to messages, as the MIDI 1.0 specification has them on the wire.

mido's parser is for files: on a wire a message may come without its status byte, if it is that of the message before
(running status), and with real-time bytes between its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

_REAL_TIME = 0xF8
"""The least status byte that stands for itself, and may come anywhere."""
_SYSTEM = 0xF0
"""The least status byte that belongs to no channel; what begins with it ends the running status."""
_ONE_DATA_BYTE = (0xC0, 0xD0)
"""Program change and channel pressure; all other messages of a channel have two."""


class Message(NamedTuple):
    """A message of a channel, or a real-time byte."""

    status: int
    """128 to 255."""
    data: tuple[int, ...] = ()
    """0 to 127 each."""

    @property
    def kind(self) -> int:
        """The status without the channel: 0x90 is note on."""
        return self.status if self.status >= _SYSTEM else self.status & 0xF0

    @property
    def channel(self) -> int:
        """0 to 15; of no meaning for a real-time byte."""
        return self.status & 0x0F


class MidiStream:
    """Takes bytes in whatever pieces they come. System exclusive and system common messages are passed over."""

    def __init__(self) -> None:
        """Begin where nothing is known: data bytes count from the first status byte on."""
        self._status = 0
        """Status byte of the message that data bytes belong to; 0: they belong to none that matters."""
        self._data: tuple[int, ...] = ()

    def feed(self, data: bytes) -> Iterator[Message]:
        """Yield the messages that these bytes complete, in order."""
        for byte in data:
            if byte >= _REAL_TIME:
                yield Message(byte)
            elif byte >= 0x80:
                self._status = byte if byte < _SYSTEM else 0
                self._data = ()
            elif self._status:
                self._data += (byte,)
                if len(self._data) == (1 if self._status & 0xF0 in _ONE_DATA_BYTE else 2):
                    yield Message(self._status, self._data)
                    self._data = ()
