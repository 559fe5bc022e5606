"""The velocity command of a walking robot: from an option, or from the keys of a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.mit import VELOCITY_COMMAND, Extern, FloatArray

__all__ = ["VELOCITY_KEYS", "VelocityCommand", "parse_velocity", "velocity_key_help"]

_STEP = 0.1
"""m/s, and rad/s, that one key press adds."""

VELOCITY_KEYS: Mapping[str, tuple[float, float, float]] = MappingProxyType(
    {
        "w": (_STEP, 0.0, 0.0),
        "s": (-_STEP, 0.0, 0.0),
        ",": (0.0, _STEP, 0.0),
        ".": (0.0, -_STEP, 0.0),
        "j": (0.0, 0.0, _STEP),
        "k": (0.0, 0.0, -_STEP),
        "0": (0.0, 0.0, 0.0),
    }
)
"""Key to what it adds to vx, vy and the yaw rate; all zeros: stop."""


def velocity_key_help() -> str:
    """One line that names the keys."""
    return f"velocity, by {_STEP:g}: w s forward and back, , . left and right, j k turn left and right, 0 stop"


def parse_velocity(text: str, ranges: FloatArray | None) -> FloatArray:
    """Read `vx,vy,wz`.

    Args:
        text: three numbers, m/s, m/s and rad/s.
        ranges: shape (3, 2), what the policy knows; None: anything.

    Raises:
        InputError: if there are not three finite numbers, or one is outside of its range.
    """
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != 3 or not all(math.isfinite(value) for value in values):
        raise InputError(f"--command: is '{text}', expected vx,vy,wz: three numbers in m/s, m/s and rad/s")
    if ranges is not None:
        for name, value, (low, high) in zip(("vx", "vy", "wz"), values, ranges, strict=True):
            if not low <= value <= high:
                raise InputError(f"--command: {name} is {value:g}, expected {low:g} to {high:g}, what the policy knows")
    return np.array(values)


class VelocityCommand:
    """An `ExternSource` that holds one command until it is changed. Another thread may change it."""

    def __init__(self, command: FloatArray, ranges: FloatArray | None = None) -> None:
        """Start with a command.

        Args:
            command: shape (3,), vx and vy in m/s, yaw rate in rad/s, heading frame.
            ranges: shape (3, 2), to which changes are clipped; None: none.
        """
        self._ranges = ranges
        self._value = np.array(command, dtype=np.float64)
        self._extern = {VELOCITY_COMMAND: Extern(self._value, 0.0)}

    @property
    def command(self) -> FloatArray:
        """Shape (3,)."""
        return self._value

    def latest(self) -> Mapping[str, Extern]:
        """The command; it holds until it is changed, and so it never grows too old."""
        return self._extern

    def press(self, key: str) -> None:
        """Change the command as a key says; other keys do nothing."""
        change = VELOCITY_KEYS.get(key)
        if change is None:
            return
        value = self._value + change if any(change) else np.zeros(3)
        if self._ranges is not None:
            value = np.clip(value, self._ranges[:, 0], self._ranges[:, 1])
        self._value = np.round(value, 6)
        self._extern = {VELOCITY_COMMAND: Extern(self._value, 0.0)}
