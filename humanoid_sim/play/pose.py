"""The pose of a real robot for viewers and pictures: its joints as measured, its base as it stands in the model."""

from __future__ import annotations

import numpy as np

from humanoid_sim.mit import FloatArray, MITState
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import build_model

__all__ = ["MeasuredPose"]


class MeasuredPose:
    """From a state to MuJoCo's generalised position. A joint that was never heard stands in its initial position."""

    def __init__(self, description: RobotDescription) -> None:
        """Find the joints in the robot's model.

        Raises:
            InputError: the MJCF does not fit the description.
        """
        model = build_model(description, scene=False)
        self._initial = np.array(description.initial_position)
        self._qpos: FloatArray = model.qpos0.copy()
        self._joints = np.array([model.joint(name).qposadr[0] for name in description.joint_names])

    def __call__(self, state: MITState) -> FloatArray:
        """Shape (nq,), read-only."""
        qpos = self._qpos.copy()
        qpos[self._joints] = np.where(np.isfinite(state.joint_position), state.joint_position, self._initial)
        qpos.setflags(write=False)
        return qpos
