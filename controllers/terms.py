"""One term of a policy's observation, as a contract writes it down: what it means and every convention it depends on.

Exporters give the same quantity different names; `TERM_KINDS` maps each known name to its meaning. A convention that
differs between sources is an option of the term, so that any wiring, a wrong one too, can be written down.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.parameters import joint_tuple
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import FloatArray, frozen_array

__all__ = [
    "TERM_KINDS",
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

TERM_KINDS: Mapping[str, str] = MappingProxyType(
    {
        "joint_pos": "joint_pos",
        "joint_pos_rel": "joint_pos",
        "dof_pos": "joint_pos",
        "joint_vel": "joint_vel",
        "joint_vel_rel": "joint_vel",
        "dof_vel": "joint_vel",
        "actions": "actions",
        "last_action": "actions",
        "base_ang_vel": "base_ang_vel",
        "imu_ang_vel": "base_ang_vel",
        "imu_angular_velocity": "base_ang_vel",
        "imu_quaternion": "imu_quaternion",
        "imu_linear_acceleration": "imu_linear_acceleration",
        "projected_gravity": "projected_gravity",
        "base_lin_vel": "base_lin_vel",
        "velocity_commands": "velocity_command",
        "velocity_command": "velocity_command",
        "twist": "velocity_command",
        "command_lin_vel": "command_lin_vel",
        "command_ang_vel": "command_ang_vel",
        "motion_command": "motion_command",
        "motion": "motion_command",
        "motion_anchor_pos_b": "motion_anchor_pos",
        "motion_anchor_ori_b": "motion_anchor_ori",
        "motion_ref_ori_b": "motion_anchor_ori",
        "sin_phase": "sin_phase",
        "cos_phase": "cos_phase",
        "gait_phase": "gait_phase",
        "motion_body_pos_b": "motion_body_pos_b",
        "motion_body_ori_b": "motion_body_ori_b",
        "target_keys": "target_keys",
        "target_keys_future": "target_keys_future",
        "progress": "progress",
        "key_pressed": "key_pressed",
    }
)
"""Every known name of a term, and its meaning. The name `command` means whatever the contract's command is."""


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """One observation term. Processing order: the value, its conventions, clip, scale, history."""

    name: str
    """As the exporter calls it."""
    kind: str = ""
    """Its meaning, one of the values of `TERM_KINDS`; empty: by its name. Any other is the name of a live input."""
    scale: FloatArray | float = 1.0
    """Scalar, or one factor per value. 0 feeds zeros."""
    clip: tuple[float, float] | None = None
    """Bounds before scaling."""
    history: int = 1
    """Number of policy steps that are shown, this one included."""
    history_order: HistoryOrder = "oldest_first"
    frame: Frame = "body"
    """For velocities and the anchor position."""
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

    def __post_init__(self) -> None:
        where = f"observation term '{self.name}'"
        set_field = object.__setattr__
        if not self.name or not isinstance(self.name, str):
            raise FieldError(f"observation term: its name is {self.name!r}, expected a text")
        set_field(self, "kind", self.kind or TERM_KINDS.get(self.name, self.name))
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
        choices = {
            "history_order": HistoryOrder,
            "frame": Frame,
            "layout": OrientationLayout,
            "quaternion": QuaternionOrder,
            "form": ActionForm,
        }
        for name, accepted in choices.items():
            if getattr(self, name) not in get_args(accepted):
                raise FieldError(
                    f"{where}: {name} is {getattr(self, name)!r}, expected one of {', '.join(get_args(accepted))}"
                )

    @property
    def is_plain(self) -> bool:
        """Neither clipped nor scaled."""
        return self.clip is None and bool(np.all(np.equal(self.scale, 1.0)))

    def process(self, value: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Clip, then scale, a value of shape (..., width)."""
        if self.clip is not None:
            value = np.clip(value, *self.clip)
        return value * self.scale

    def check_width(self, width: int) -> None:
        """Refuse a scale that has another width than the term.

        Raises:
            FieldError: naming both.
        """
        size = np.shape(self.scale)
        if size not in ((), (1,), (width,)):
            raise FieldError(f"observation term '{self.name}': scale has {size[0]} values, expected 1 or {width}")
