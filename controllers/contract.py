"""What a checkpoint needs to run: one frozen struct, whatever file it came from."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from humanoid_sim.controllers.parameters import joint_tuple, number, per_joint
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import FloatArray

__all__ = ["PolicyContract", "TaskType"]

TaskType = Literal["tracking", "piano", "locomotion"]

_OWNER = "PolicyContract"


@dataclass(frozen=True, slots=True, eq=False)
class PolicyContract:
    """The thirteen keys that a self-describing checkpoint carries, checked against each other."""

    task_type: TaskType
    """Selects the layout of the motion reference."""
    joint_names: tuple[str, ...]
    """The full articulation, n joints; the order of the per-joint arrays."""
    action_joint_names: tuple[str, ...]
    """The m joints that the action drives, in its order; the others are pinned to position 0."""
    joint_stiffness: FloatArray
    """Shape (n,), N·m/rad."""
    joint_damping: FloatArray
    """Shape (n,), N·m·s/rad."""
    default_joint_pos: FloatArray
    """Shape (n,), rad."""
    observation_names: tuple[str, ...]
    """The flat observation, term by term."""
    command_names: tuple[str, ...]
    """Runtime command terms."""
    action_scale: FloatArray
    """Shape (m,) or scalar, rad per unit of action."""
    policy_dt: float
    """s"""
    body_names: tuple[str, ...]
    """Bodies that the motion reference describes, b of them."""
    dataset_repo_id: str = ""
    """Where the default motion comes from; empty for none."""
    lookahead_steps: tuple[int, ...] = ()
    """Policy steps ahead of the present one that `target_keys_future` shows (piano)."""

    def __post_init__(self) -> None:
        set_field = object.__setattr__
        if self.task_type not in get_args(TaskType):
            raise FieldError(
                f"{_OWNER}.task_type: is {self.task_type!r}, expected one of {', '.join(get_args(TaskType))}"
            )
        set_field(self, "joint_names", joint_tuple(_OWNER, self.joint_names, "joint_names"))
        set_field(self, "action_joint_names", joint_tuple(_OWNER, self.action_joint_names, "action_joint_names"))
        strangers = [joint for joint in self.action_joint_names if joint not in self.joint_names]
        if strangers:
            raise FieldError(
                f"{_OWNER}.action_joint_names: {', '.join(strangers)} not in joint_names: {', '.join(self.joint_names)}"
            )
        for name in ("joint_stiffness", "joint_damping"):
            set_field(self, name, per_joint(_OWNER, name, getattr(self, name), self.joint_names, minimum=0.0))
        set_field(
            self, "default_joint_pos", per_joint(_OWNER, "default_joint_pos", self.default_joint_pos, self.joint_names)
        )
        set_field(self, "action_scale", per_joint(_OWNER, "action_scale", self.action_scale, self.action_joint_names))
        set_field(self, "observation_names", joint_tuple(_OWNER, self.observation_names, "observation_names"))
        set_field(self, "policy_dt", number(_OWNER, "policy_dt", self.policy_dt, above=True))
        for name in ("command_names", "body_names"):
            set_field(self, name, joint_tuple(_OWNER, getattr(self, name), name, may_be_empty=True))
        self._check_lookahead()

    def _check_lookahead(self) -> None:
        if not isinstance(self.lookahead_steps, Iterable):
            raise FieldError(f"{_OWNER}.lookahead_steps: is {self.lookahead_steps!r}, expected integers >= 0")
        steps = tuple(self.lookahead_steps)
        if any(isinstance(step, bool) or not isinstance(step, int | np.integer) or step < 0 for step in steps):
            raise FieldError(f"{_OWNER}.lookahead_steps: is {steps}, expected integers >= 0")
        if "target_keys_future" in self.observation_names and not steps:
            raise FieldError(f"{_OWNER}.lookahead_steps: is empty, but the observation has target_keys_future")
        object.__setattr__(self, "lookahead_steps", tuple(int(step) for step in steps))

    @property
    def action_count(self) -> int:
        """m, the width of the action."""
        return len(self.action_joint_names)
