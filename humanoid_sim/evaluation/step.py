"""One policy step of a robot or a batch, and what it is judged by: robot, contract and motion."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.reference import Alignment, Frame, MotionReference
from humanoid_sim.controllers.rotation import quaternion_from_matrix, rotation_from_6d
from humanoid_sim.mit import BoolArray, Float32Array, FloatArray, MITState
from humanoid_sim.robots.schema import RobotDescription
from humanoid_sim.simulation.floating_base import BaseState

_STOP_MARGIN = 0.05  # rad from a joint's limit within which it counts as at its stop


Needs = Literal[
    "", "motion", "motion of bodies", "motion with joints", "motion with an anchor", "floating base", "song"
]
"""Part of robot, contract or motion that a figure may need."""


def _empty() -> Any:
    return np.zeros(0)


@dataclass(frozen=True, slots=True, eq=False)
class StepSample:
    """One policy step: an action, and the state that it led to one `policy_dt` later."""

    state: MITState
    frame: Frame  # shape (...), the reference frame that belongs to `state`: 1 after the first step; the last is held
    action: Float32Array = field(default_factory=_empty)  # shape (..., m), raw, in force during the step
    previous_action: Float32Array = field(default_factory=_empty)  # shape (..., m), raw; at first zeros
    torque: FloatArray = field(default_factory=_empty)  # shape (..., n), N·m, saturated, of the last physics step
    step: int | npt.NDArray[np.integer] = 0  # shape (...), policy steps since the start, this one included
    body_position: FloatArray = field(default_factory=_empty)  # shape (..., b, 3), m, tracked bodies, base frame
    body_quaternion: FloatArray = field(default_factory=_empty)  # shape (..., b, 4), w x y z, of either sign
    command: FloatArray = field(default_factory=_empty)  # shape (..., 3), vx, vy (m/s) and yaw rate (rad/s)
    base: BaseState | None = None  # of a floating base; None for a fixed one
    alignment: Alignment | None = None  # of the reference with the robot at the start


class StepContext:
    """Robot, contract and motion of a sample."""

    def __init__(
        self,
        description: RobotDescription,
        contract: PolicyContract,
        reference: MotionReference,
        standing_height: float = 0.0,
    ) -> None:
        """Prepare for a robot whose centre of mass stands `standing_height`, m, above the floor; 0 for a fixed base."""
        self.description, self.contract, self.reference = description, contract, reference
        self.standing_height = standing_height
        self.lowest, self.highest = description.lower + _STOP_MARGIN, description.upper - _STOP_MARGIN
        """Shape (n,), rad: beyond these a joint is at its stop."""
        self.inverse_effort = 1.0 / np.array(description.effort_limit)
        order = joint_indices(description.joint_names, contract.joint_names, "joints of the robot")
        terms, joints = reference.terms, "reference_joint_pos"
        self.joint_target = terms[joints][:, order].astype(np.float64) if joints in terms else None
        """Shape (F, n), rad, robot's order, by frame."""
        self.tracked = contract.body_names if "motion_body_pos_b" in terms else ()
        """Bodies that the motion has in the base frame, b of them."""
        hands = [i for i, name in enumerate(self.tracked) if name in description.hands]
        self.hands = hands or list(range(len(self.tracked)))
        """Indices of the tracked bodies that are hands; all of them if none is."""
        has_anchor = "anchor_pos" in terms and bool(contract.anchor_body)
        known: dict[Needs, bool] = {
            "": True,
            "motion": bool(self.tracked) or has_anchor,
            "motion of bodies": bool(self.tracked),
            "motion with joints": joints in terms,
            "motion with an anchor": has_anchor,
            "floating base": description.is_floating,
            "song": description.piano is not None and "target_keys" in terms,
        }
        self.parts = {needs for needs, is_there in known.items() if is_there}

    @cached_property
    def body_target(self) -> tuple[FloatArray, FloatArray]:
        """Positions (F, b, 3), m, and quaternions (F, b, 4) of the tracked bodies in the base frame."""
        count, terms = len(self.tracked), self.reference.terms
        columns = terms["motion_body_ori_b"].astype(np.float64).reshape(-1, count, 6)
        position = terms["motion_body_pos_b"].astype(np.float64).reshape(-1, count, 3)
        return position, quaternion_from_matrix(rotation_from_6d(columns))

    @cached_property
    def song(self) -> BoolArray:
        """Shape (F, 88), the keys to hold down."""
        return np.asarray(self.reference.terms["target_keys"] > 0.5)
