"""The spaces of a policy's action and observation, with bounds that mean something.

An action beyond its bounds commands nothing that one at its bounds does not: there the position error alone saturates
the motor, wherever the joint is. An observation beyond its bounds is no robot's any more, and ends the episode.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box

from humanoid_sim.controllers.observation import stack
from humanoid_sim.controllers.policy_step import PolicyWiring
from humanoid_sim.controllers.term_values import Limits, Request
from humanoid_sim.robots.schema import RobotDescription

__all__ = ["action_space", "observation_space", "outlier"]

_ROUNDING = 1.001
"""Float32 makes unit vectors a little longer than 1."""


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
    limits = Limits(description.lower, description.upper, wiring.action_limit)
    for resolved in wiring.layout.terms:
        term, kind = resolved.term, wiring.contract.kind(resolved.term)
        request = Request(term, kind, wiring.contract, wiring.joints, wiring.reference, wiring.extern)
        width = resolved.stop - resolved.start
        ends = np.stack([np.broadcast_to(end, width) for end in kind.limits(request, limits)])
        step[:, resolved.start : resolved.stop] = np.sort(term.process(ends * _ROUNDING), axis=0)
    (low, high), _ = stack(wiring.layout, step, None)
    return Box(low, high, dtype=np.float32)


def outlier(wiring: PolicyWiring, observation: npt.NDArray[np.float32], inside: npt.NDArray[np.bool_]) -> str:
    """What lies beyond the bounds in one observation, shape (N,); `inside` says which values do not."""
    i = int(np.argmin(inside))
    return f"observation {wiring.layout.locate(i)} is {observation[i]}, beyond any robot's"
