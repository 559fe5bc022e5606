"""The gait clock: how the phase that a policy observes moves from one policy step to the next."""

from __future__ import annotations

import numpy as np

from humanoid_sim.controllers.contract import PhaseRule
from humanoid_sim.mit import BoolArray, FloatArray


def advance_phase(
    rule: PhaseRule, walked: FloatArray | float, command: FloatArray, policy_dt: float
) -> tuple[FloatArray, FloatArray]:
    """One policy step.

    Args:
        walked: shape (...), rad walked since activation, or since standing; 0 at activation.
        command: shape (..., 3), the velocity command.
        policy_dt: s.

    Returns:
        `walked` of the next step, shape (...), and the phase to show now, shape (..., k), rad in [-π, π), or the
        standing value; NaN where that is None.
    """
    standing, before = _is_standing(rule, command), np.asarray(walked)
    after = before + _step(rule, command, policy_dt)
    value = np.nan if rule.standing_value is None else rule.standing_value
    shown = np.where(standing[..., None], value, _feet(rule, after if rule.advance_first else before))
    return np.where(standing & rule.standing_restarts, 0.0, after), shown


def shown_phase(rule: PhaseRule, walked: FloatArray | float, command: FloatArray, policy_dt: float) -> FloatArray:
    """Return the phase that the latest observation shows, shape (..., k), rad; NaN while the robot stands.

    Args:
        walked: shape (...), rad, of the memory with that observation.
        command: shape (..., 3), the velocity command in it.
        policy_dt: s.
    """
    shown = np.asarray(walked) - (0.0 if rule.advance_first else _step(rule, command, policy_dt))
    return np.where(_is_standing(rule, command)[..., None], np.nan, _feet(rule, shown))


def _feet(rule: PhaseRule, walked: FloatArray) -> FloatArray:
    """Shape (..., k), rad in [-π, π), of feet that have walked so far, shape (...)."""
    phase: FloatArray = np.mod(walked[..., None] + rule.offsets + np.pi, 2.0 * np.pi) - np.pi
    return phase


def _is_standing(rule: PhaseRule, command: FloatArray) -> BoolArray:
    return np.asarray(_magnitude(command, 3) < rule.standing_threshold)


def _step(rule: PhaseRule, command: FloatArray, policy_dt: float) -> FloatArray | float:
    """Return by how much the clock moves in one policy step, rad; shape (...) where the command decides."""
    if rule.frequency is None:
        assert rule.period is not None  # a rule has one or the other
        return 2.0 * np.pi * policy_dt / rule.period
    speed = _magnitude(command, {"command": 3, "planar": 2, "forward": 1}[rule.speed])
    hertz: FloatArray = np.interp(speed, rule.frequency[:, 0], rule.frequency[:, 1])
    return 2.0 * np.pi * policy_dt * hertz


def _magnitude(command: FloatArray, count: int) -> FloatArray:
    """Shape (...), of the first values of commands, shape (..., 3)."""
    square = command[..., 0] ** 2
    for i in range(1, count):
        square = square + command[..., i] ** 2
    return np.sqrt(square)
