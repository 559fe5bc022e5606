"""From a policy's raw action to joint positions; shared by environment, player and robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.joint_order import joint_indices
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import FloatArray, MITCommand

__all__ = ["ActionMap", "action_command", "resolve_action"]


@dataclass(frozen=True, slots=True, eq=False)
class ActionMap:
    """The contract's action in the robot's joint order."""

    indices: npt.NDArray[np.intp]
    """Shape (m,), the robot's joint that each action drives."""
    offset: FloatArray
    """Shape (m,), rad."""
    scale: FloatArray
    """Shape (m,), rad per unit of action."""
    stiffness: FloatArray
    """Shape (n,), N·m/rad, robot order."""
    damping: FloatArray
    """Shape (n,), N·m·s/rad, robot order."""
    clip: float = float("inf")
    """Magnitude at which a raw action is clipped."""
    position_clip: FloatArray | None = None
    """Shape (m, 2), rad, least and greatest position; None: any."""


def resolve_action(contract: PolicyContract, robot_joints: tuple[str, ...]) -> ActionMap:
    """Match the policy's joints with the robot's by name: a permutation, or a clear error.

    Raises:
        FieldError: naming the joints that only one side has.
    """
    missing = [joint for joint in contract.joint_names if joint not in robot_joints]
    surplus = [joint for joint in robot_joints if joint not in contract.joint_names]
    if missing or surplus:
        parts = [f"the robot lacks {', '.join(missing)}"] * bool(missing)
        parts += [f"the policy lacks {', '.join(surplus)}"] * bool(surplus)
        raise FieldError(f"joint_names of the policy do not match the robot's joints: {'; '.join(parts)}")
    robot_order = joint_indices(robot_joints, contract.joint_names, "joints of the robot")
    assert contract.action_offset is not None  # filled in at construction
    return ActionMap(
        indices=joint_indices(contract.action_joint_names, robot_joints, "action_joint_names of the policy"),
        offset=contract.action_offset,
        scale=contract.action_scale,
        stiffness=contract.joint_stiffness[robot_order],
        damping=contract.joint_damping[robot_order],
        clip=contract.action_clip,
        position_clip=contract.position_clip,
    )


def action_command(action_map: ActionMap, action: npt.NDArray[np.float32]) -> MITCommand:
    """`position = offset + scale · action` on the driven joints, 0 on the others, the policy's gains on all.

    Args:
        action_map: from `resolve_action`.
        action: shape (..., m), raw.

    Returns:
        A command of shape (..., n); velocity and effort are 0.
    """
    if action_map.clip < np.inf:
        action = np.clip(action, -action_map.clip, action_map.clip)
    shape = (*action.shape[:-1], action_map.stiffness.shape[0])
    position = np.zeros(shape)
    driven = action_map.offset + action_map.scale * action
    if action_map.position_clip is not None:
        driven = np.clip(driven, action_map.position_clip[:, 0], action_map.position_clip[:, 1])
    position[..., action_map.indices] = driven
    zeros = np.zeros(shape)
    return MITCommand(
        position=position,
        velocity=zeros,
        effort=zeros,
        stiffness=np.broadcast_to(action_map.stiffness, shape),
        damping=np.broadcast_to(action_map.damping, shape),
    )
