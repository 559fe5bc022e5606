"""Whether an exported checkpoint answers what the network answered that it was made of."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import HumanoidSimError
from humanoid_sim.policy.checkpoint import Checkpoint

__all__ = ["require_same_answers"]

_TOLERANCE = 1e-4
"""action, of one up to 1 and relative beyond: ONNX Runtime adds up in another order than PyTorch."""


def require_same_answers(
    checkpoint: Checkpoint, observations: npt.NDArray[np.float32], expected: npt.NDArray[np.float32]
) -> None:
    """Compare the checkpoint's actions on observations (k, N) with those of the network, (k, m).

    Raises:
        HumanoidSimError: they differ: a defect of the export.
    """
    actual = np.array([checkpoint.policy(observation, 0) for observation in observations])
    worst = float((np.abs(actual - expected) / np.maximum(np.abs(expected), 1.0)).max())
    if not worst <= _TOLERANCE:
        raise HumanoidSimError(f"{checkpoint.source}: its actions differ from the network's by up to {worst:g}")
