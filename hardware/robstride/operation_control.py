"""Operation control frames for all motors of a bus at once: the control loop's only encoding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import FieldError
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.robstride.commands import LARGEST_MOTOR_ID
from humanoid_sim.hardware.robstride.frames import FrameType
from humanoid_sim.hardware.robstride.scale import SIGNED_STEPS, UNSIGNED_STEPS
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.motors import MotorModel

__all__ = ["EncodedCommands", "OperationControlEncoder"]

_FIELDS = ("position", "velocity", "effort", "stiffness", "damping")
_SIGNED = 3
"""The first fields, which have a sign."""
_EFFORT = 2


@dataclass(frozen=True, slots=True, eq=False)
class EncodedCommands:
    """Frames, and what did not fit into them."""

    frames: tuple[Frame, ...]
    """One per motor, in the encoder's order."""
    saturated: npt.NDArray[np.bool_]
    """Shape (5, motors): whether position, velocity, effort, stiffness or damping was cut off."""


class OperationControlEncoder:
    """Encodes like `encode_command` in the reference's convention, bit for bit, for motors in a fixed order."""

    def __init__(self, motor_ids: Sequence[int], models: Sequence[MotorModel]) -> None:
        """Precompute the ranges.

        Raises:
            FieldError: an id is not one of 1 to 127.
        """
        for motor_id in motor_ids:
            if not 1 <= motor_id <= LARGEST_MOTOR_ID:
                raise FieldError(f"OperationControl.motor_id: is {motor_id}, expected 1 to {LARGEST_MOTOR_ID}")
        self._identifiers = [FrameType.OPERATION_CONTROL << 24 | motor_id for motor_id in motor_ids]
        self._upper = np.array([[getattr(model, name) for model in models] for name in _FIELDS])
        self._lower = np.where(np.arange(len(_FIELDS))[:, None] < _SIGNED, -self._upper, 0.0)

    def encode(self, values: FloatArray) -> EncodedCommands:
        """The frames of all motors.

        Args:
            values: shape (5, motors), motor frame: position rad, velocity rad/s, effort N·m, stiffness N·m/rad,
                damping N·m·s/rad.

        Raises:
            FieldError: a value is not finite.
        """
        if not np.isfinite(values).all():
            row, column = np.argwhere(~np.isfinite(values))[0]
            motor_id = self._identifiers[column] & 0xFF
            value = values[row, column]
            raise FieldError(
                f"OperationControl.{_FIELDS[row]}: is {value} for motor {motor_id}, expected a finite number"
            )
        clipped = np.clip(values, self._lower, self._upper)
        scaled = clipped / self._upper
        scaled[:_SIGNED] = (scaled[:_SIGNED] + 1.0) * SIGNED_STEPS
        scaled[_SIGNED:] *= UNSIGNED_STEPS
        raw = scaled.astype(np.uint16)  # truncates, as the reference does
        efforts = raw[_EFFORT].tolist()
        data = raw[[0, 1, 3, 4]].T.astype(">u2").tobytes()
        frames = tuple(
            Frame(identifier | effort << 8, data[8 * i : 8 * i + 8])
            for i, (identifier, effort) in enumerate(zip(self._identifiers, efforts, strict=True))
        )
        return EncodedCommands(frames, clipped != values)
