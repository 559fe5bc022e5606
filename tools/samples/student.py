"""The policy's network: one arm's network, run for the left arm and for the mirrored right arm.

It has three parts, plain multi-layer perceptrons with SiLU units. `shoulder` and `wrist` find the joint positions of
the frame that is shown: the first from the elbow's pose, the second from the rotation between elbow and hand.
`shoulder` also sees where the joints are, because some poses of the elbow have two solutions. `feedback` turns the
distance between these positions, the joints and the last action into a correction: it leads the motion, holds against
gravity, damps. A command is never far ahead of its joint, so that a jump of the reference becomes no blow.
All inputs are scaled here, so nothing outside needs to know of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import cast

import numpy as np
import torch
from torch import Tensor, nn

from humanoid_sim.mit import FloatArray
from tools.samples import scales
from tools.samples.arm import ARM_JOINTS, JOINT_SIGN, ORIENTATION_SIGN, POSITION_SIGN

__all__ = ["ArmNetwork", "ArmTarget", "Student"]


@dataclass(frozen=True, slots=True)
class ArmTarget:
    """A frame of the motion as the network takes it in, before it knows where the joints are."""

    elbow: Tensor
    """Shape (..., 12): position and rotation of the elbow, scaled."""
    wrist: Tensor
    """Shape (..., 3), actions: the wrist's joints, solved."""

    def at(self, step: int) -> ArmTarget:
        """One step of targets of shape (B, T, ...)."""
        return ArmTarget(self.elbow[:, step], self.wrist[:, step])


class ArmNetwork(nn.Module):
    """The network of one arm, in the left arm's coordinates. Joint positions are relative to the default pose."""

    def __init__(self, origin: FloatArray) -> None:
        """Untrained; `origin` is where the left shoulder's axes meet, shape (3,), m, base frame."""
        super().__init__()
        self.shoulder = _perceptron(12 + scales.ELBOW_JOINTS, 192, 192, 192, scales.ELBOW_JOINTS)
        self.wrist = _perceptron(9, 128, 128, ARM_JOINTS - scales.ELBOW_JOINTS)
        self.feedback = _perceptron(5 * ARM_JOINTS, 128, 128, ARM_JOINTS)
        last = cast("nn.Linear", self.feedback[-1])
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.largest_lead = torch.tensor(scales.LARGEST_LEAD)
        self.origin = torch.tensor(origin, dtype=torch.float32)

    def target(self, position: Tensor, columns: Tensor) -> ArmTarget:
        """Take in a frame.

        Args:
            position: shape (..., 2, 3), m, base frame: elbow and hand.
            columns: shape (..., 2, 3, 2), the first two columns of their rotation matrices.
        """
        third = torch.linalg.cross(columns[..., 0], columns[..., 1], dim=-1)
        rotation = torch.cat([columns, third[..., None]], dim=-1)
        elbow, hand = rotation[..., 0, :, :], rotation[..., 1, :, :]
        offset = (position[..., 0, :] - self.origin) * scales.LENGTH
        relative = elbow.transpose(-1, -2) @ hand
        return ArmTarget(torch.cat([offset, elbow.flatten(-2)], dim=-1), self.wrist(relative.flatten(-2)))

    def solve(self, target: ArmTarget, joints: Tensor) -> Tensor:
        """Return the frame's joint positions as actions, shape (..., 7), given the joints' own, (..., 7), rad."""
        elbow = self.shoulder(torch.cat([target.elbow, joints[..., : scales.ELBOW_JOINTS]], dim=-1))
        return torch.cat([elbow, target.wrist], dim=-1)

    def correct(self, solution: Tensor, joints: Tensor, velocity: Tensor, last_action: Tensor) -> Tensor:
        """Return the action, shape (..., 7), for a solved frame.

        Args:
            solution: shape (..., 7), from `solve`.
            joints: shape (..., 7), rad, relative to the default pose.
            velocity: shape (..., 7), rad/s.
            last_action: shape (..., 7).
        """
        scale = scales.ACTION
        features = [
            solution,
            velocity * scales.VELOCITY,
            (solution * scale - joints) * scales.TRACKING,
            (last_action - solution) * scales.CHANGE,
            (last_action * scale - joints) * scales.LEAD,
        ]
        action = solution + scales.CORRECTION * cast("Tensor", self.feedback(torch.cat(features, dim=-1)))
        lead = self.largest_lead * torch.tanh((action * scale - joints) / self.largest_lead)
        return (joints + lead) / scale

    def forward(self, target: ArmTarget, joints: Tensor, velocity: Tensor, last_action: Tensor) -> Tensor:
        """Return the action, shape (..., 7)."""
        return self.correct(self.solve(target, joints), joints, velocity, last_action)


class Student(nn.Module):
    """The policy: flat observations (B, 78) to actions (B, 14), both arms through one `ArmNetwork`."""

    def __init__(self, arm: ArmNetwork) -> None:
        super().__init__()
        self.arm = arm

    def forward(self, observation: Tensor) -> Tensor:
        """Terms in order: body positions 12, body orientations 24, joint positions, joint velocities, last action."""
        position, columns, *joints = torch.split(observation, [12, 24, 14, 14, 14], dim=-1)
        signs = _both_sides(JOINT_SIGN)
        target = self.arm.target(
            position.reshape(-1, 2, 2, 3) * _both_sides(POSITION_SIGN)[:, None],
            columns.reshape(-1, 2, 2, 3, 2) * _both_sides(ORIENTATION_SIGN),
        )
        action = self.arm(target, *(term.reshape(-1, 2, ARM_JOINTS) * signs for term in joints))
        return cast("Tensor", (action * signs).reshape(-1, 2 * ARM_JOINTS))


def _both_sides(right: FloatArray) -> Tensor:
    """Ones for the left arm and the mirror's signs for the right, stacked in front."""
    return torch.tensor(np.stack([np.ones_like(right), right]), dtype=torch.float32)


def _perceptron(*widths: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for inputs, outputs in pairwise(widths):
        layers += [nn.Linear(inputs, outputs), nn.SiLU()]
    return nn.Sequential(*layers[:-1])
