"""The spaces of a policy's action and observation, with bounds that mean something.

An action beyond its bounds commands nothing that one at its bounds does not: there the position error alone saturates
the motor, wherever the joint is. An observation beyond its bounds is no robot's any more, and ends the episode.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box

from humanoid_sim.controllers.observation import ObservationTerm, stack
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.policy_step import PolicyWiring
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.schema import RobotDescription

__all__ = ["action_space", "observation_space", "outlier"]

_ROUNDING = 1.001
"""Float32 makes unit vectors a little longer than 1."""
_BEYOND_STOP = 0.5
"""rad by which a joint may be pressed into its stop."""
_ANY_POSITION = 100.0
"""rad, of a joint without limits."""

_MAGNITUDES: Mapping[str, float] = MappingProxyType(
    {
        "joint_vel": 100.0,
        "base_ang_vel": 100.0,
        "imu_quaternion": 1.0,
        "imu_linear_acceleration": 1e5,
        "projected_gravity": 1.0,
        "base_lin_vel": 100.0,
        "velocity_command": 10.0,
        "command_lin_vel": 10.0,
        "command_ang_vel": 10.0,
        "motion_anchor_pos": 1000.0,
        "motion_anchor_ori": 1.0,
        "sin_phase": 1.0,
        "cos_phase": 1.0,
        "gait_phase": 1.0,
        "progress": 1.0,
    }
)
"""Largest magnitude of a term, in its own unit (rad/s, m/s², m/s, m or 1), before clip and scale."""


def action_space(wiring: PolicyWiring, description: RobotDescription) -> Box:
    """Bounds of the raw action, shape (m,).

    Targets from `lower - effort_limit / K_p` to `upper + effort_limit / K_p`, in units of the action; the limit of the
    raw action where a joint has no limits or no stiffness.
    """
    actions, driven = wiring.action_map, wiring.action_map.indices
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = description.effort_limit[driven] / actions.stiffness[driven]
        ends = np.stack([description.lower[driven] - reach, description.upper[driven] + reach])
        raw = np.sort((ends - actions.offset) / actions.scale, axis=0)
    exact = min(wiring.action_limit, actions.clip)
    limit = np.float32(exact)
    if limit > np.float64(exact):  # rounded up: the bound itself would be refused
        limit = np.nextafter(limit, np.float32(0.0))
    low, high = np.where(np.isfinite(raw), np.clip(raw, -limit, limit), [[-limit], [limit]]).astype(np.float32)
    is_useless = low >= high  # the whole range lies beyond the limit
    return Box(np.where(is_useless, -limit, low), np.where(is_useless, limit, high), dtype=np.float32)


def observation_space(wiring: PolicyWiring, description: RobotDescription) -> Box:
    """Bounds of the observation, shape (N,)."""
    step = np.empty((2, wiring.layout.step_width), dtype=np.float32)
    for term in wiring.layout.terms:
        ends = np.stack(np.broadcast_arrays(*_bounds(term, wiring, description), np.empty(term.stop - term.start))[:2])
        step[:, term.start : term.stop] = np.sort(term.term.process(ends * _ROUNDING), axis=0)
    (low, high), _ = stack(wiring.layout, step, None)
    return Box(low, high, dtype=np.float32)


def outlier(wiring: PolicyWiring, observation: npt.NDArray[np.float32], inside: npt.NDArray[np.bool_]) -> str:
    """What lies beyond the bounds in one observation, shape (N,); `inside` says which values do not."""
    i = int(np.argmin(inside))
    return f"observation {wiring.layout.locate(i)} is {observation[i]}, beyond any robot's"


def _bounds(
    term: ObservationTerm, wiring: PolicyWiring, description: RobotDescription
) -> tuple[npt.ArrayLike, npt.ArrayLike]:
    contract, kind = wiring.contract, term.term.kind
    if kind == "command":
        kind = "motion_command" if "motion" in contract.command_names else "velocity_command"
    if kind == "joint_pos":
        return _joint_bounds(term, wiring, description)
    magnitude: npt.ArrayLike = _MAGNITUDES.get(kind, 1.0)  # other live inputs are keys: pressed or not
    if kind == "actions":
        magnitude = min(wiring.action_limit, contract.action_clip)
        if term.term.form == "scaled":
            magnitude = magnitude * np.abs(contract.action_scale)
    elif kind == "motion_command":
        tables = [wiring.reference.terms[name] for name in ("reference_joint_pos", "reference_joint_vel")]
        magnitude = max(float(np.abs(table).max()) for table in tables) + float(
            np.abs(contract.default_joint_pos).max()
        )
    elif kind in wiring.reference.terms:
        magnitude = max(1.0, float(np.abs(wiring.reference.terms[kind]).max()))
    return np.negative(magnitude), magnitude


def _joint_bounds(
    term: ObservationTerm, wiring: PolicyWiring, description: RobotDescription
) -> tuple[FloatArray, FloatArray]:
    names = wiring.contract.joint_names if term.term.joints is None else term.term.joints
    order = joint_indices(names, description.joint_names, "joint_names of the policy")
    default = wiring.contract.default_joint_pos[joint_indices(names, wiring.contract.joint_names, "joint_names")]
    if term.term.relative is False:
        default = np.zeros_like(default)
    low, high = description.lower[order] - _BEYOND_STOP, description.upper[order] + _BEYOND_STOP
    return (
        np.where(np.isfinite(low), low, -_ANY_POSITION) - default,
        np.where(np.isfinite(high), high, _ANY_POSITION) - default,
    )
