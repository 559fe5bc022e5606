"""A MIDI keyboard at the level of its bytes, on a FIFO."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class EmulatedKeyboard:
    """Plugged in until `unplug`."""

    def __init__(self, path: str, *handles: int) -> None:
        self.path = path
        self._handles = handles
        """The first is written to."""

    def send(self, *data: int) -> None:
        """Bytes, as they are on the wire."""
        os.write(self._handles[0], bytes(data))

    def press(self, *notes: int, channel: int = 0) -> None:
        for note in notes:
            self.send(0x90 | channel, note, 64)

    def release(self, *notes: int, channel: int = 0) -> None:
        for note in notes:
            self.send(0x80 | channel, note, 0)

    def unplug(self) -> None:
        for handle in self._handles:
            os.close(handle)
        self._handles = ()


@contextmanager
def on_fifo(path: Path) -> Iterator[EmulatedKeyboard]:
    """Plug one in; the FIFO stays when it is unplugged, as a device's name may."""
    if not path.exists():
        os.mkfifo(path)
    keyboard = EmulatedKeyboard(str(path), os.open(path, os.O_RDWR | os.O_NONBLOCK))
    try:
        yield keyboard
    finally:
        keyboard.unplug()
