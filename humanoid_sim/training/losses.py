"""Costs, and the conversion of training data for PyTorch."""

from __future__ import annotations

import torch
from torch import Tensor

from humanoid_sim.mit import FloatArray

__all__ = ["patient", "quadratic", "soft", "tensor"]


def tensor(array: FloatArray) -> Tensor:
    """A float32 copy."""
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
