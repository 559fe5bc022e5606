"""The stand-in where no policy can run: it answers zeros, so the robot holds a default pose."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import Policy
from humanoid_sim.policy.checkpoint import Checkpoint
from humanoid_sim.robots.description import RobotDescription

__all__ = ["PLACEHOLDER", "placeholder_checkpoint", "zero_policy"]

PLACEHOLDER = "placeholder"


def zero_policy(action_count: int) -> Policy:
    """A policy that answers zeros of shape (m,), whatever it sees."""
    action = np.zeros(action_count, dtype=np.float32)
    action.setflags(write=False)

    def policy(observation: npt.NDArray[np.float32], frame: int) -> npt.NDArray[np.float32]:  # noqa: ARG001
        return action

    return policy


def placeholder_checkpoint(
    description: RobotDescription, pose: Literal["a", "b"] = "a", policy_dt: float = 0.02
) -> Checkpoint:
    """A zero policy for any robot: it observes the joints and holds the final pose of standby A or B."""
    joints = description.joint_names
    standby = description.standby_controller_a if pose == "a" else description.standby_controller_b
    contract = PolicyContract(
        task_type="locomotion",
        joint_names=joints,
        action_joint_names=joints,
        joint_stiffness=description.stiffness,
        joint_damping=description.damping,
        default_joint_pos=np.asarray(standby.pose_segments[-1]),
        observation=("joint_pos", "joint_vel", "actions"),
        command_names=(),
        action_scale=np.ones(len(joints)),
        policy_dt=policy_dt,
        body_names=(),
    )
    return Checkpoint(contract, zero_policy(len(joints)), PLACEHOLDER)
