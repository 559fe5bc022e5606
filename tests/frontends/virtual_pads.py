"""Gamepads that SDL itself makes: plugged in, pressed and pulled out through the library that pygame-ce brings."""

import ctypes
from pathlib import Path

import pygame

__all__ = ["VirtualPad"]

_SDL = ctypes.CDLL(str(next((Path(pygame.__file__).parent.parent / "pygame_ce.libs").glob("libSDL2-2*"))))
_SDL.SDL_JoystickOpen.restype = ctypes.c_void_p
_SDL.SDL_JoystickFromInstanceID.restype = ctypes.c_void_p
_SDL.SDL_JoystickSetVirtualButton.argtypes = (ctypes.c_void_p, ctypes.c_int, ctypes.c_uint8)
_SDL.SDL_JoystickSetVirtualAxis.argtypes = (ctypes.c_void_p, ctypes.c_int, ctypes.c_int16)
_SDL.SDL_JoystickClose.argtypes = (ctypes.c_void_p,)
_SDL.SDL_JoystickInstanceID.argtypes = (ctypes.c_void_p,)
_SDL.SDL_GetError.restype = ctypes.c_char_p

_KNOWN, _UNKNOWN = 1, 0
_SDL_BUTTONS = {"A": 0, "B": 1, "X": 2, "Y": 3, "BACK": 4, "START": 6, "L1": 9, "R1": 10}
"""SDL's order of a controller's buttons, which is not that of `sensor_msgs/Joy`."""


class _Description(ctypes.Structure):
    """`SDL_VirtualJoystickDesc` of SDL 2.24 and later."""

    _fields_ = (
        ("version", ctypes.c_uint16),
        ("type", ctypes.c_uint16),
        ("naxes", ctypes.c_uint16),
        ("nbuttons", ctypes.c_uint16),
        ("nhats", ctypes.c_uint16),
        ("vendor_id", ctypes.c_uint16),
        ("product_id", ctypes.c_uint16),
        ("padding", ctypes.c_uint16),
        ("button_mask", ctypes.c_uint32),
        ("axis_mask", ctypes.c_uint32),
        ("name", ctypes.c_char_p),
        ("userdata", ctypes.c_void_p),
        ("update", ctypes.c_void_p),
        ("set_player_index", ctypes.c_void_p),
        ("rumble", ctypes.c_void_p),
        ("rumble_triggers", ctypes.c_void_p),
        ("set_led", ctypes.c_void_p),
        ("send_effect", ctypes.c_void_p),
    )


class VirtualPad:
    """Plugged in from its construction until `unplug`; SDL must have been started."""

    def __init__(self, name: str = "Test Pad", *, known: bool = True, buttons: int = 15, axes: int = 6) -> None:
        description = _Description(
            version=1, type=_KNOWN if known else _UNKNOWN, naxes=axes, nbuttons=buttons, name=name.encode()
        )
        self._index = _SDL.SDL_JoystickAttachVirtualEx(ctypes.byref(description))
        assert self._index >= 0, _SDL.SDL_GetError().decode()
        self._handle = _SDL.SDL_JoystickOpen(self._index)
        self.identity = _SDL.SDL_JoystickInstanceID(self._handle)
        self._is_in = True

    def press(self, *buttons: str | int, down: bool = True) -> None:
        for button in buttons:
            index = _SDL_BUTTONS[button] if isinstance(button, str) else button
            assert _SDL.SDL_JoystickSetVirtualButton(self._handle, index, int(down)) == 0

    def release(self, *buttons: str | int) -> None:
        self.press(*buttons, down=False)

    def push(self, axis: int, part: float) -> None:
        """-1 (up, left) to 1."""
        assert _SDL.SDL_JoystickSetVirtualAxis(self._handle, axis, round(32767 * part)) == 0

    def unplug(self) -> None:
        if self._is_in:
            self._is_in = False
            for index in range(_SDL.SDL_NumJoysticks()):
                if _SDL.SDL_JoystickGetDeviceInstanceID(index) == self.identity:
                    assert _SDL.SDL_JoystickDetachVirtual(index) == 0
            _SDL.SDL_JoystickClose(self._handle)
