"""Gamepads at the level of the joystick driver's events: FIFOs in a folder that stands for `/dev/input`."""

import os
import struct

from humanoid_sim.frontends.pads import Described, Pads

XBOX = {"A": 0x130, "B": 0x131, "X": 0x133, "Y": 0x134, "L1": 0x136, "R1": 0x137, "BACK": 0x13A, "START": 0x13B}
"""Key codes of xpad, the driver of Xbox pads."""
DUALSENSE = {**XBOX, "X": 0x134, "Y": 0x133, "L2": 0x138, "R2": 0x139}
"""Of hid-playstation, which names the place of a button; X is the left one."""
BLUETOOTH = {**XBOX, "C": 0x132, "Z": 0x135, "L2": 0x138, "R2": 0x139}
"""Of an Xbox pad over Bluetooth: all codes of a gamepad in order."""
JOYSTICK = {number: 0x120 + number for number in range(6)}
"""Of an unknown device."""


class FakePads(Pads):
    """Gamepads that a test plugs in."""

    def __init__(self, folder):
        super().__init__(folder, self._described)
        self.folder, self._known, self._plugged = folder, {}, []

    def plug(self, codes=XBOX, name="Test Pad", held=()):
        number = len(self._known)
        path = self.folder / f"js{number}"
        os.mkfifo(path)
        pad = FakePad(path, tuple(codes), held)
        self._known[os.stat(path).st_ino] = Described(name, tuple(codes.values()), (0, 1, 2, 3, 4, 5))
        self._plugged.append(pad)
        return pad

    def close(self):
        for pad in self._plugged:
            pad.unplug()
        super().close()

    def _described(self, handle):
        return self._known[os.fstat(handle).st_ino]


class FakePad:
    def __init__(self, path, names, held):
        self._path, self._names = path, names
        self._handle = os.open(path, os.O_RDWR | os.O_NONBLOCK)
        for name in names:
            self._send(1 | 0x80, self._names.index(name), name in held)

    def _send(self, kind, number, value):
        os.write(self._handle, struct.pack("<IhBB", 0, value, kind, number))

    def press(self, *buttons, down=True):
        for button in buttons:
            self._send(1, self._names.index(button), down)

    def release(self, *buttons):
        self.press(*buttons, down=False)

    def push(self, axis, part):
        """-1 (up, left) to 1."""
        self._send(2, axis, round(32767 * part))

    def unplug(self):
        if self._handle is not None:
            self._path.unlink()
            os.close(self._handle)
            self._handle = None
