"""Gamepads as Linux's joystick driver has them, `/dev/input/js*`, in the order of `sensor_msgs/Joy` for an Xbox pad."""

from __future__ import annotations

import array
import fcntl
import os
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

_EVENT = struct.Struct("<IhBB")  # time, value, kind, number; <linux/joystick.h>, as all here
_BUTTON, _AXIS, _INITIAL = 1, 2, 0x80
_GET_NAME, _GET_AXES, _GET_BUTTONS = 0x80806A13, 0x80016A11, 0x80016A12  # JSIOCGNAME(128), JSIOCGAXES, JSIOCGBUTTONS
_GET_AXIS_MAP, _GET_BUTTON_MAP = 0x80406A32, 0x84006A34  # JSIOCGAXMAP, JSIOCGBTNMAP
_FULL = 32767.0
_SOUTH, _EAST, _C, _NORTH, _WEST = range(0x130, 0x135)  # <linux/input-event-codes.h>
_TL, _TR, _TL2, _SELECT, _START = 0x136, 0x137, 0x138, 0x13A, 0x13B
_X, _Y, _Z, _RX, _RY, _RZ = range(6)
BUTTON_COUNT = 8


class Described(NamedTuple):
    """Facts that a driver reports of its device."""

    name: str
    buttons: tuple[int, ...]
    """Key code of each button."""
    axes: tuple[int, ...]
    """Code of each axis."""


def describe(handle: int) -> Described:
    """Return what the driver of an open device reports."""
    name, button_count, axis_count = bytearray(128), bytearray(1), bytearray(1)
    buttons, axes = array.array("H", bytes(1024)), bytearray(64)
    fcntl.ioctl(handle, _GET_NAME, name)
    fcntl.ioctl(handle, _GET_BUTTONS, button_count)
    fcntl.ioctl(handle, _GET_AXES, axis_count)
    fcntl.ioctl(handle, _GET_BUTTON_MAP, buttons)
    fcntl.ioctl(handle, _GET_AXIS_MAP, axes)
    text = name.partition(b"\0")[0].decode(errors="replace")
    return Described(text, tuple(buttons[: button_count[0]]), tuple(axes[: axis_count[0]]))


class Pad:
    """One gamepad that is plugged in."""

    def __init__(self, path: Path, describe: Callable[[int], Described]) -> None:
        """Open it. Raises `OSError` if it is gone, or not readable."""
        self._handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            self.name, codes, axes = describe(self._handle)
        except OSError:
            self.close()
            raise
        # Drivers that report the place of a button have TL2 and no C; others name X and Y as Xbox pads are labelled.
        x, y = (_WEST, _NORTH) if _TL2 in codes and _C not in codes else (_NORTH, _WEST)
        wanted = (_SOUTH, _EAST, x, y, _TL, _TR, _SELECT, _START)
        self.is_known = set(wanted) <= set(codes)
        self._buttons = {codes.index(code): place for place, code in enumerate(wanted)} if self.is_known else {}
        right = (_RX, _RY) if _RX in axes else (_Z, _RZ)
        self._axes = {axes.index(code): place for place, code in enumerate((_X, _Y, *right)) if code in axes}
        self.buttons = (False,) * BUTTON_COUNT
        """A, B, X, Y, L1, R1, BACK, START: True while it is down."""
        self.changes: list[tuple[tuple[bool, ...], tuple[bool, ...]]] = []
        """Buttons before and after each press or release since the poll before."""
        self.axes = [0.0] * 4
        """Left stick x and y, right stick x and y, -1 to 1; left and up are -1."""

    def close(self) -> None:
        os.close(self._handle)

    def poll(self) -> bool:
        """Read its new events; False if it is gone."""
        self.changes = []
        try:
            data = os.read(self._handle, 64 * _EVENT.size)
        except BlockingIOError:
            return True
        except OSError:
            return False
        for _, value, kind, number in _EVENT.iter_unpack(data):
            if kind & ~_INITIAL == _AXIS and number in self._axes:
                self.axes[self._axes[number]] = max(value / _FULL, -1.0)
            if kind & ~_INITIAL == _BUTTON and number in self._buttons:
                before, place = self.buttons, self._buttons[number]
                self.buttons = (*before[:place], bool(value), *before[place + 1 :])
                if not kind & _INITIAL:  # a button that is down when the gamepad comes was not pressed
                    self.changes.append((before, self.buttons))
        return bool(data)


class Pads:
    """The gamepads of this machine."""

    def __init__(self, folder: Path = Path("/dev/input"), describe: Callable[[int], Described] = describe) -> None:
        self._folder, self._describe = folder, describe
        self._open: dict[str, Pad] = {}

    def poll(self) -> tuple[Pad, ...]:
        """Return those that are there, by the number of their device, with their new events."""
        for path in sorted(self._folder.glob("js*")):
            if path.name not in self._open:
                try:
                    self._open[path.name] = Pad(path, self._describe)
                except OSError:  # unplugged just now, or not readable
                    continue
        for name, pad in list(self._open.items()):
            if not pad.poll():
                pad.close()
                del self._open[name]
        return tuple(self._open.values())

    def close(self) -> None:
        while self._open:
            self._open.popitem()[1].close()


def describe_pads(pads: Sequence[Pad], folder: Path = Path("/dev/input")) -> tuple[bool, list[str]]:
    """Return True if one can be used, and a line on each, or why there is none."""
    lines = [
        pad.name if pad.is_known else f"{pad.name} cannot be used: its layout is not known, expected XInput's"
        for pad in pads
    ]
    none = f"no gamepad is plugged in, as {folder}/js* of the kernel's module joydev"
    for path in sorted(folder.glob("js*")):
        if not os.access(path, os.R_OK):
            none = f"{path}: this user may not read it: sudo usermod -aG input $USER, then log in again"
    return any(pad.is_known for pad in pads), lines or [none]
