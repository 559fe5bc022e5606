"""One step of a policy on a robot, apart from the policy itself; shared by controller, environments and rollouts.

`observe`, the policy, `accepts`, `act`: everything takes `(..., n)`, one robot or a batch, and a batch gives bit for
bit what its robots give one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import JOINT_LIMITS, PhaseRule, PolicyContract
from humanoid_sim.controllers.observation import ObservationLayout, pack, resolve_observation, stack
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.reference import Alignment, Frame, MotionReference
from humanoid_sim.controllers.terms import TermInput, anchor_pose, live_command
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import (
    BoolArray,
    Float32Array,
    FloatArray,
    IndexArray,
    MITCommand,
    MITState,
)
from humanoid_sim.names import list_joints

Policy = Callable[[Float32Array, int], npt.ArrayLike]
"""`(observation of shape (N,), reference frame) -> raw action of shape (m,)`. Same input, same output."""


@dataclass(frozen=True, slots=True, eq=False)
class PolicyMemory:
    """State carried from one policy step to the next."""

    frame: Frame  # shape (...), the reference frame that the next inference shows
    last_action: Float32Array  # shape (..., m), raw; zeros at activation
    history: Float32Array | None = None  # (..., h, step_width), the last steps, oldest first; None: none, or not needed
    walked: FloatArray | float = 0.0  # shape (...), rad of gait phase since activation, or since standing
    alignment: Alignment | None = None  # alignment of the reference with the robot, made at activation


@dataclass(frozen=True, slots=True, eq=False)
class PolicyWiring:
    """A contract resolved on a robot: what its policy observes, and what its actions do.

    Raises `FieldError` at construction, if the contract does not fit the robot, or a term lacks its source.
    """

    joints: tuple[str, ...]  # the robot's, in its order
    contract: PolicyContract
    reference: MotionReference
    extern: Mapping[str, int]  # name and width of the live inputs that states carry
    layout: ObservationLayout = field(init=False, repr=False)
    action_map: ActionMap = field(init=False, repr=False)
    takes_velocity_command: bool = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if isinstance(self.contract.position_clip, str):
            raise FieldError(f"position_clip: is '{JOINT_LIMITS}', and no robot is known whose they are")
        put = partial(object.__setattr__, self)
        put("action_map", resolve_action(self.contract, self.joints))
        put("layout", resolve_observation(self.contract, self.joints, self.reference, self.extern))
        put("takes_velocity_command", self.contract.takes_velocity_command)

    def activate(self, state: MITState) -> PolicyMemory:
        """Start with no last action, and with the first frame of the reference aligned with the robot."""
        batch = state.joint_position.shape[:-1]
        aligns = self.contract.align_reference and "anchor_pos" in self.reference.terms
        return PolicyMemory(
            frame=np.zeros(batch, dtype=np.int64) if batch else 0,
            last_action=np.zeros((*batch, self.contract.action_count), dtype=np.float32),
            walked=np.zeros(batch) if batch else 0.0,
            alignment=self.reference.align(anchor_pose(state)) if aligns else None,
        )

    def observe(self, memory: PolicyMemory, state: MITState) -> tuple[Float32Array, PolicyMemory]:
        """Return the observation, shape (..., N), and the memory with it; `FieldError` for a live input's shape."""
        rule, walked, phase = self.contract.phase, memory.walked, np.empty(0)
        if rule is not None:
            command = live_command(state, self.contract)
            walked, phase = advance_phase(rule, walked, command, self.contract.policy_dt)
        now = TermInput(state, memory.last_action, memory.frame, memory.alignment, phase)
        observation, history = stack(self.layout, pack(self.layout, now), memory.history)
        if history is None and rule is None:
            return observation, memory
        return observation, PolicyMemory(memory.frame, memory.last_action, history, walked, memory.alignment)

    def observation_problem(self, observation: Float32Array) -> str:
        """Return why one observation, shape (N,), must not reach the policy; '' if it may."""
        finite = np.isfinite(observation)
        if finite.all():
            return ""
        i = int(np.argmin(finite))
        is_missing = np.isnan(observation[i]) and self.layout.term_at(i).kind.topic
        why = ": no value has come, or the last one is too old" if is_missing else ""
        return f"observation {self.layout.locate(i)} is {observation[i]}, expected a finite number{why}"

    def accepts(self, action: Float32Array) -> BoolArray:
        """Return whether all values of raw actions, shape (..., m), are finite and within the limit: shape (...)."""
        return np.asarray(self._within(action).all(axis=-1))

    def action_problem(self, action: Float32Array) -> str:
        """Return why one raw action, shape (m,), is not accepted; '' if it is."""
        if action.shape != (self.contract.action_count,):
            return f"action has shape {action.shape}, expected ({self.contract.action_count},)"
        within = self._within(action)
        if within.all():
            return ""
        i = int(np.argmin(within))
        hint = ": action_limit in a contract.yaml raises it" if np.isfinite(action[i]) else ""
        joint = self.contract.action_joint_names[i]
        return f"action of {joint} is {action[i]}, expected a magnitude <= {self.contract.action_limit:g}{hint}"

    def _within(self, action: Float32Array) -> BoolArray:
        return np.asarray(np.abs(action) <= np.float64(self.contract.action_limit))  # in float32 1e300 is infinite

    def act(self, memory: PolicyMemory, action: Float32Array) -> tuple[PolicyMemory, MITCommand]:
        """Return the command of an action, shape (..., m), and the memory with it, one frame on."""
        frame = self.reference.following(memory.frame)
        advanced = PolicyMemory(frame, action, memory.history, memory.walked, memory.alignment)
        return advanced, action_command(self.action_map, action)


def advance_phase(
    rule: PhaseRule, walked: FloatArray | float, command: FloatArray, policy_dt: float
) -> tuple[FloatArray, FloatArray]:
    """Advance the gait clock by one policy step, in s.

    Takes `walked`, shape (...), rad since activation or standing, and the velocity command, shape (..., 3). Returns
    `walked` of the next step, and the phase to show, shape (..., k), rad in [-π, π); the standing value, NaN for None.
    """
    speed = np.sqrt(command[..., 0] ** 2 + command[..., 1] ** 2 + command[..., 2] ** 2)
    standing = np.asarray(speed < rule.standing_threshold)
    before = np.asarray(walked)
    after = before + 2.0 * np.pi * policy_dt / rule.period
    shown = after if rule.advance_first else before
    phase = np.mod(shown[..., None] + rule.offsets + np.pi, 2.0 * np.pi) - np.pi
    value = np.nan if rule.standing_value is None else rule.standing_value
    return np.where(standing & rule.standing_restarts, 0.0, after), np.where(standing[..., None], value, phase)


@dataclass(frozen=True, slots=True, eq=False)
class ActionMap:
    """A contract's action in the robot's joint order."""

    contract: PolicyContract
    indices: IndexArray  # shape (m,), the robot's joint that each action drives
    offset: FloatArray  # shape (m,), rad
    stiffness: FloatArray  # shape (n,), N·m/rad, robot order
    damping: FloatArray  # shape (n,), N·m·s/rad, robot order


def resolve_action(contract: PolicyContract, robot_joints: tuple[str, ...]) -> ActionMap:
    """Match the policy's joints with the robot's by name; `FieldError` naming the joints that only one side has."""
    missing = [joint for joint in contract.joint_names if joint not in robot_joints]
    surplus = [joint for joint in robot_joints if joint not in contract.joint_names]
    if missing or surplus:
        sides = (("robot", missing), ("policy", surplus))
        parts = [f"the {side} lacks {list_joints(names)}" for side, names in sides if names]
        raise FieldError(f"joint_names of the policy do not match the robot's joints: {'; '.join(parts)}")
    order = joint_indices(robot_joints, contract.joint_names, "joints of the robot")
    driven = joint_indices(contract.action_joint_names, robot_joints, "action_joint_names of the policy")
    stiffness, damping = contract.joint_stiffness[order], contract.joint_damping[order]
    for gains in (stiffness, damping):
        gains.setflags(write=False)
    assert contract.action_offset is not None  # filled in at construction
    return ActionMap(contract, driven, contract.action_offset, stiffness, damping)


def action_command(action_map: ActionMap, action: Float32Array) -> MITCommand:
    """Return the command of raw actions, shape (..., m), for all joints, shape (..., n).

    `position = offset + scale · action` on driven joints, 0 on others, the policy's gains on all.
    """
    contract = action_map.contract
    driven = action_map.offset + contract.action_scale * contract.clipped(action)
    if isinstance(contract.position_clip, np.ndarray):
        driven = np.clip(driven, contract.position_clip[:, 0], contract.position_clip[:, 1])
    stiffness, damping = action_map.stiffness, action_map.damping
    shape = (*action.shape[:-1], *stiffness.shape)
    if action.ndim > 1:
        stiffness, damping = np.broadcast_to(stiffness, shape), np.broadcast_to(damping, shape)
    position, zeros = np.zeros(shape), np.zeros(shape)
    position[..., action_map.indices] = driven
    return MITCommand(position, zeros, zeros, stiffness, damping)
