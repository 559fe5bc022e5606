"""First part of training: the geometry of the arm, and the command that holds it against gravity. Nothing moves.

The costs are those of the second part too.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor, nn

from humanoid_sim.mit import FloatArray
from tools.samples import scales
from tools.samples.student import ArmNetwork
from tools.samples.teacher import TrainingPoses

__all__ = ["PoseBatches", "patient", "quadratic", "soft", "tensor", "train_statics"]

_HOLD_SHARE = 0.3
"""Weight of holding against gravity, relative to the geometry."""


def tensor(array: FloatArray) -> Tensor:
    """Return a float32 copy."""
    return torch.tensor(array, dtype=torch.float32)


def quadratic(error: Tensor, weight: Tensor) -> Tensor:
    """`e W e` for errors (..., 7), rad, and weights (..., 7, 7), 1/rad²: shape (...)."""
    return (error[..., None, :] @ weight @ error[..., :, None])[..., 0, 0]


def soft(cost: Tensor, knee: float = 4.0) -> Tensor:
    """Huber's idea for a cost that is a square: from `knee` on it grows with the root, so that outliers do not rule."""
    return torch.where(cost < knee, cost, 2.0 * (knee * cost.clamp(min=knee)).sqrt() - knee)


def patient(cost: Tensor, knee: float = 4.0) -> Tensor:
    """From `knee` on a cost grows only with its logarithm: a far target is no reason to hurry."""
    return knee * torch.log1p(cost / knee)


class PoseBatches:
    """Random batches of training poses, and what the network makes of them."""

    def __init__(self, poses: TrainingPoses, default: Tensor, generator: torch.Generator) -> None:
        self._position = tensor(poses.body_position)
        self._columns = tensor(poses.body_rotation[..., :2])
        self._joints = tensor(poses.joint_position) - default
        self._weight = tensor(poses.weight)
        self._sag = tensor(poses.sag)
        self._generator = generator

    def cost(self, network: ArmNetwork, size: int, *, with_hold: bool) -> tuple[Tensor, Tensor]:
        """Mean cost of the solved poses, and of the held ones (0 without)."""
        rows = torch.randint(len(self._joints), (size,), generator=self._generator)
        joints, weight = self._joints[rows], self._weight[rows]
        target = network.target(self._position[rows], self._columns[rows])
        solution = network.solve(target, joints + self._where_the_joints_are(joints))
        scale = scales.ACTION
        geometry = soft(quadratic(solution * scale - joints, weight)).mean()
        if not with_hold:
            return geometry, torch.zeros(())
        held = joints + self._sag[rows]
        action = network.correct(
            solution,
            joints + 0.03 * self._normal(joints),
            0.3 * self._normal(joints),
            held / scale + 0.05 * self._normal(joints),
        )
        return geometry, soft(quadratic(action * scale - held, weight)).mean()

    def _where_the_joints_are(self, joints: Tensor) -> Tensor:
        """Off the frame's pose by little mostly, by a lot sometimes: enough to tell two solutions apart, no more."""
        spread = torch.rand(len(joints), 1, generator=self._generator)
        return torch.where(spread < 0.8, 0.05 + 0.25 * spread, 0.6) * self._normal(joints)

    def _normal(self, like: Tensor) -> Tensor:
        return torch.randn(like.shape, generator=self._generator)


def train_statics(
    network: ArmNetwork,
    batches: PoseBatches,
    steps: int,
    *,
    batch_size: int = 2048,
    learning_rate: float = 3e-3,
    report: Callable[[int, float], None],
) -> None:
    """Train in place; `report` gets the number of steps done and the present cost."""
    optimizer = torch.optim.AdamW(network.parameters(), learning_rate, weight_decay=1e-5)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, learning_rate, steps)
    recent: list[float] = []
    for step in range(steps):
        geometry, hold = batches.cost(network, batch_size, with_hold=True)
        loss = geometry + _HOLD_SHARE * hold
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 50.0)
        optimizer.step()
        schedule.step()
        recent = [*recent[-49:], loss.item()]
        report(step + 1, float(np.mean(recent)))
