"""A motion as its source has it, before anything about its conventions is believed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.terms import QuaternionOrder
from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray

_UNIT = 0.02
"""Largest distance of a quaternion's norm from 1: float32 and interpolation leave much less."""
_ARRAYS = ("joint_position", "joint_velocity", "base_position", "base_quaternion", "body_position", "body_quaternion")
_JOINT_SUFFIXES = ("", ".pos", ".position", "_pos", "_dof")
"""Suffixes that exporters append to a joint's name."""


@dataclass(frozen=True, slots=True, eq=False)
class SourceMotion:
    """One episode of F frames. What the source does not hold is None."""

    source: str
    """Name for messages."""
    kind: str
    """Format, for the report."""
    fps: float
    """Frames per second."""
    joint_position: FloatArray | None = None
    """Shape (F, n), rad, in the source's order."""
    joint_velocity: FloatArray | None = None
    """Shape (F, n), rad/s."""
    joint_names: tuple[str, ...] | None = None
    """As the source names them; None where it does not."""
    base_position: FloatArray | None = None
    """Shape (F, 3), m, world frame, of the robot's base body."""
    base_quaternion: FloatArray | None = None
    """Shape (F, 4), in the order `quaternion_order`."""
    body_position: FloatArray | None = None
    """Shape (F, B, 3), m, in `frame`."""
    body_quaternion: FloatArray | None = None
    """Shape (F, B, 4), in the order `quaternion_order`."""
    body_names: tuple[str, ...] = ()
    """As the source names them; empty where it does not."""
    frame: Literal["world", "base"] = "world"
    """Frame of the bodies' poses: the world's, or that of the robot's base body."""
    quaternion_order: QuaternionOrder = "wxyz"
    quaternion_order_source: str = "assumed by format"
    """Origin of that, for the report."""

    def __post_init__(self) -> None:
        for name, array in self.arrays().items():
            with np.errstate(invalid="ignore", over="ignore"):  # what becomes of it is refused below
                object.__setattr__(self, name, np.asarray(array, dtype=np.float64))
        arrays = self.arrays()
        if not arrays:
            raise InputError(f"{self.source}: holds neither joint positions nor body poses")
        if not (np.isfinite(self.fps) and self.fps > 0.0):
            raise InputError(f"{self.source}: fps is {self.fps:g}, expected a positive number of frames per second")
        first, count = next(iter(arrays)), self.frame_count
        for name, array in arrays.items():
            if len(array) == 0:
                raise InputError(f"{self.source}: {name} has no frames")
            if len(array) != count:
                others = f"{first} has {count}; expected the same number in all"
                raise InputError(f"{self.source}: {name} has {len(array)} frames, {others}")
            bad = np.argwhere(~np.isfinite(array))
            if len(bad):
                frame, *index = (int(i) for i in bad[0])
                raise InputError(
                    f"{self.source}: {name} is {array[tuple(bad[0])]} at frame {frame}, index {_shown(index)}, "
                    "expected a finite number"
                )
        self._check_widths()
        for name in ("base_quaternion", "body_quaternion"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, self._unit(name, getattr(self, name)))

    def arrays(self) -> dict[str, FloatArray]:
        """Return what the source holds, by field; each of F rows."""
        return {field: getattr(self, field) for field in _ARRAYS if getattr(self, field) is not None}

    def _check_widths(self) -> None:
        for position, other, what, names in (
            (self.joint_position, self.joint_velocity, "joint velocities", self.joint_names),
            (self.body_position, self.body_quaternion, "body orientations", self.body_names),
        ):
            if position is None:
                continue
            kind, count = what.partition(" ")[0], position.shape[1]
            if other is not None and other.shape[1] != count:
                raise InputError(f"{self.source}: has {count} {kind} positions and {other.shape[1]} {what} per frame")
            if not names:
                continue
            name = f"{kind}_names"
            if len(names) != count:
                raise InputError(f"{self.source}: {name} has {len(names)} names for {count} columns")
            twice = [other for other in names if names.count(other) > 1]
            if twice:
                raise InputError(f"{self.source}: {name} has '{twice[0]}' twice")

    def _unit(self, name: str, quaternion: FloatArray) -> FloatArray:
        with np.errstate(over="ignore"):  # becomes infinite, which is not a unit
            norm = np.sqrt((quaternion * quaternion).sum(axis=-1))
        bad = np.argwhere(np.abs(norm - 1.0) > _UNIT)
        if len(bad):
            frame, *index = (int(i) for i in bad[0])
            where = f", body {index[0]}" if index else ""
            raise InputError(
                f"{self.source}: {name} at frame {frame}{where} has norm {norm[tuple(bad[0])]:.3g}, "
                "expected a unit quaternion"
            )
        unit: FloatArray = quaternion / norm[..., None]
        return unit

    def select(self, frames: npt.NDArray[np.intp]) -> SourceMotion:
        """Return the motion with these frames only; its rate means nothing then."""
        chosen: dict[str, Any] = {name: array[frames] for name, array in self.arrays().items()}
        return replace(self, **chosen)

    @property
    def frame_count(self) -> int:
        """F."""
        return len(next(iter(self.arrays().values())))


def swap_quaternion_order(quaternion: FloatArray, order: QuaternionOrder) -> FloatArray:
    """Quaternions (..., 4) in the given order, as w x y z."""
    return quaternion if order == "wxyz" else np.roll(quaternion, 1, axis=-1)


def other_quaternion_order(order: QuaternionOrder) -> QuaternionOrder:
    """Return the one of the two orders that this is not."""
    return "xyzw" if order == "wxyz" else "wxyz"


def joint_of(column: str, joints: tuple[str, ...]) -> str | None:
    """Return the joint whose position a column is by its name; None if there is none."""
    names = (column.removesuffix(suffix) for suffix in _JOINT_SUFFIXES if column.endswith(suffix))
    return next((name for name in names if name in joints), None)


def _shown(index: list[int]) -> str:
    return str(index[0]) if len(index) == 1 else str(tuple(index))
