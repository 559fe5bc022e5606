"""One term of a policy's observation, as a contract writes it down: what it means and every convention it depends on.

A convention that differs between sources is an option of the term, so that any wiring, a wrong one too, can be written
down. What kinds of terms there are is in `term_kinds`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.parameters import joint_tuple
from humanoid_sim.controllers.term_kinds import TERM_NAMES, is_known
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import BASE, IMU, FloatArray, frozen_array

__all__ = [
    "ActionForm",
    "Frame",
    "HistoryOrder",
    "OrientationLayout",
    "QuaternionOrder",
    "Term",
]

Frame = Literal["body", "world"]
OrientationLayout = Literal["rows", "columns", "two_rows"]
QuaternionOrder = Literal["wxyz", "xyzw"]
HistoryOrder = Literal["oldest_first", "newest_first"]
ActionForm = Literal["raw", "scaled"]
_CHOICES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "history_order": get_args(HistoryOrder),
        "frame": get_args(Frame),
        "layout": get_args(OrientationLayout),
        "quaternion": get_args(QuaternionOrder),
        "form": get_args(ActionForm),
    }
)


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """One observation term. Processing order: the value, its conventions, clip, scale, history."""

    name: str
    """As the exporter calls it."""
    kind: str = ""
    """Its meaning, a name of `TERM_KINDS` or `command`; empty: by its name. Any other is the name of a live input."""
    scale: FloatArray | float = 1.0
    """Scalar, or one factor per value. 0 feeds zeros."""
    clip: tuple[float, float] | None = None
    """Bounds before scaling."""
    history: int = 1
    """Number of policy steps that are shown, this one included."""
    history_order: HistoryOrder = "oldest_first"
    frame: Frame = "body"
    """For velocities and the anchor position."""
    at: str = BASE
    """For the velocity of the base, which point's: `base` for its origin, `imu`, or the name of a site."""
    relative: bool | None = None
    """For joint positions (default true) and the motion command (default false): less the default pose."""
    layout: OrientationLayout = "rows"
    """Of six orientation values: the first two columns row by row, column by column, or the first two rows."""
    inverse: bool = False
    """For the anchor orientation: seen from the reference instead of from the robot."""
    quaternion: QuaternionOrder = "wxyz"
    """For terms that are quaternions."""
    form: ActionForm = "raw"
    """For the last action: the network's output, or that times the action scale."""
    joints: tuple[str, ...] | None = None
    """For joint positions and velocities: the joints shown, in this order; None: all, in the policy's order."""
    width: int | None = None
    """Of a live input that no kind of term expresses: its number of values; None: the kind says."""

    def __post_init__(self) -> None:
        where = f"observation term '{self.name}'"
        set_field = object.__setattr__
        if not self.name or not isinstance(self.name, str):
            raise FieldError(f"observation term: its name is {self.name!r}, expected a text")
        set_field(self, "kind", self.kind or TERM_NAMES.get(self.name, self.name))
        scale = frozen_array(where, "scale", self.scale)
        if scale.ndim > 1 or not np.isfinite(scale).all():
            raise FieldError(f"{where}: scale is {self.scale}, expected a finite number, or one per value")
        set_field(self, "scale", scale)
        if self.clip is not None:
            low, high = self.clip
            if not low <= high:
                raise FieldError(f"{where}: clip is {self.clip}, expected a lower and an upper bound")
            set_field(self, "clip", (float(low), float(high)))
        if isinstance(self.history, bool) or not isinstance(self.history, int) or self.history < 1:
            raise FieldError(f"{where}: history is {self.history!r}, expected a whole number >= 1")
        if self.joints is not None:
            set_field(self, "joints", joint_tuple(where, self.joints, "joints"))
        if not isinstance(self.at, str) or not self.at.strip():
            raise FieldError(f"{where}: at is {self.at!r}, expected base, imu or the name of a site")
        if self.width is not None:
            self._check_width(where)
        for name, accepted in _CHOICES.items():
            if getattr(self, name) not in accepted:
                raise FieldError(f"{where}: {name} is {getattr(self, name)!r}, expected one of {', '.join(accepted)}")

    def _check_width(self, where: str) -> None:
        if isinstance(self.width, bool) or not isinstance(self.width, int) or self.width < 1:
            raise FieldError(f"{where}: width is {self.width!r}, expected a whole number >= 1")
        if is_known(self.kind):
            raise FieldError(f"{where}: width is {self.width}, expected none: only a live input has one of its own")

    def process(self, value: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Clip, then scale, a value of shape (..., width)."""
        if self.clip is not None:
            value = np.clip(value, *self.clip)
        return value * self.scale

    def others(self, convention: str) -> tuple[str, ...]:
        """What an option with a choice of words could be instead."""
        if convention == "at":
            return (IMU,) if self.at == BASE else (BASE,)
        return tuple(choice for choice in _CHOICES[convention] if choice != getattr(self, convention))
