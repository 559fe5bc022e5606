"""The gait clock: how the phase that a policy observes moves from one policy step to the next."""

from __future__ import annotations

import numpy as np

from humanoid_sim.controllers.contract import PhaseRule
from humanoid_sim.mit import BoolArray, FloatArray


def advance_phase(
    rule: PhaseRule, walked: FloatArray | float, command: FloatArray, policy_dt: float
) -> tuple[FloatArray, FloatArray]:
    """Advance the clock by one policy step.

    Args:
        walked: shape (...), rad since activation, or since standing; 0 at activation.
        command: shape (..., 3), the velocity command.
        policy_dt: s.

    Returns:
        `walked` of the next step, shape (...), and the phase to show now, shape (..., k), rad in [-π, π), or the
        standing value; NaN where that is None.
    """
    standing, before = _is_standing(rule, command), np.asarray(walked)
    after = before + 2.0 * np.pi * policy_dt / rule.period
    value = np.nan if rule.standing_value is None else rule.standing_value
    shown = np.where(standing[..., None], value, _feet(rule, after if rule.advance_first else before))
    return np.where(standing & rule.standing_restarts, 0.0, after), shown


def _feet(rule: PhaseRule, walked: FloatArray) -> FloatArray:
    """Return the phase of each foot, shape (..., k), rad in [-π, π), for `walked` of shape (...)."""
    phase: FloatArray = np.mod(walked[..., None] + rule.offsets + np.pi, 2.0 * np.pi) - np.pi
    return phase


def _is_standing(rule: PhaseRule, command: FloatArray) -> BoolArray:
    speed = np.sqrt(command[..., 0] ** 2 + command[..., 1] ** 2 + command[..., 2] ** 2)
    return np.asarray(speed < rule.standing_threshold)
