"""Observations of a critic in training that no robot can measure: the true state, whatever the policy sees of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import gymnasium
import numpy as np

from humanoid_sim.controllers.rotation import rotate_inverse
from humanoid_sim.errors import InputError, require_known
from humanoid_sim.evaluation.rollout import StepSample
from humanoid_sim.mit import Float32Array, FloatArray
from humanoid_sim.simulation.floating_base import BaseState

PrivilegedTerm = Callable[[StepSample], FloatArray]
"""Shape (..., w) of a policy step: one function serves one robot and a batch."""


def _base(sample: StepSample) -> BaseState:
    assert sample.base is not None
    return sample.base


_OF_A_BASE: Mapping[str, PrivilegedTerm] = MappingProxyType(
    {
        "base_height": lambda sample: _base(sample).height[..., None],
        "base_linear_velocity": lambda sample: rotate_inverse(_base(sample).quaternion, _base(sample).linear_velocity),
        "base_angular_velocity": lambda sample: _base(sample).angular_velocity,
        "base_gravity": lambda sample: _base(sample).gravity,
        "velocity_command": lambda sample: sample.command,
    }
)
PRIVILEGED_TERMS: Mapping[str, PrivilegedTerm] = MappingProxyType(
    {
        "joint_position": lambda sample: sample.state.joint_position,
        "joint_velocity": lambda sample: sample.state.joint_velocity,
        "joint_torque": lambda sample: sample.torque,
        "body_position": lambda sample: sample.body_position.reshape(*sample.body_position.shape[:-2], -1),
        **_OF_A_BASE,
    }
)
"""By name. Units: rad, rad/s, N·m; m in the base frame, and above the floor; m/s and rad/s in the base frame;
a unit vector in the base frame; the command in m/s and rad/s in the heading frame."""


class Privileged:
    """Chosen terms, one after the other in one array."""

    def __init__(self, terms: Sequence[str] | Mapping[str, PrivilegedTerm], *, is_floating: bool) -> None:
        """Choose terms. Raises `InputError` if there is no such term, or the robot has none.

        Args:
            terms: names out of `PRIVILEGED_TERMS`; or functions by a name of one's own.
            is_floating: whether the robot's base is; a fixed one has no terms of its own.
        """
        if isinstance(terms, str):
            raise InputError(f"privileged: is {terms!r}, expected a list of names")
        chosen = () if isinstance(terms, Mapping) else terms
        require_known("term", chosen, PRIVILEGED_TERMS, "privileged: ")
        for name in chosen:
            if name in _OF_A_BASE and not is_floating:
                raise InputError(f"privileged: {name} is of a floating base, and the robot's is fixed")
        functions = terms if isinstance(terms, Mapping) else {name: PRIVILEGED_TERMS[name] for name in terms}
        self.terms: Mapping[str, PrivilegedTerm] = MappingProxyType(dict(functions))
        """In their order."""

    def space(self, sample: StepSample) -> gymnasium.spaces.Box:
        """Return the space of one robot's array, by a sample of one or many."""
        width = self(sample).shape[-1]
        return gymnasium.spaces.Box(-np.inf, np.inf, (width,), dtype=np.float32)

    def __call__(self, sample: StepSample) -> Float32Array:
        """Shape (..., w), all terms of a policy step; what is not finite is 0, as of a robot that has failed."""
        parts = [np.asarray(function(sample), dtype=np.float64) for function in self.terms.values()]
        joined = np.concatenate(parts, axis=-1)
        finite: Float32Array = np.nan_to_num(joined, nan=0.0, posinf=0.0, neginf=0.0).astype(np.float32)
        return finite
