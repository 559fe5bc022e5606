"""The spaces of the environments, with bounds that mean something.

A policy's: an action beyond its bounds commands nothing that one at its bounds does not: there the position error alone
saturates the motor, wherever the joint is; an observation beyond its bounds is not a robot's any more, and ends the
episode. The whole control stack's, of `ModesEnv`: what an operator can ask of it, and what it shows.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, Space

from humanoid_sim.controllers.fsm import merge_safety
from humanoid_sim.controllers.policy_step import PolicyWiring
from humanoid_sim.messages import Intent, Mode, SafetyFlag, SafetyLevel, SafetyStatus, TickOutput
from humanoid_sim.mit import COMMAND_FIELDS, FloatArray, MITState
from humanoid_sim.robots.motors import MOTORS
from humanoid_sim.robots.schema import RobotDescription

_ROUNDING = 1.001
"""Float32 makes unit vectors a little longer than 1."""

INTENTS: tuple[Intent | None, ...] = (None, *Intent)
"""By the action's number: 0 asks for nothing."""

_FLAGS = tuple(SafetyFlag)
_STATE = tuple(field.name for field in fields(MITState) if field.name not in ("time", "extern"))
"""Names of the fields of a robot's state that an operator is shown."""
_BEYOND_STOP = 5.0
"""rad past a stop, which is soft: full effort that swings the Lite's joints to and fro drives one 2.6 rad past its."""
_ANY_POSITION = 100.0
"""rad, of a joint without limits."""
_SPEED = 1000.0
"""rad/s: ten times what is left of any robot."""
_ACCELERATION = 1e6
"""m/s², of an impact."""
_OLD = 1e6
"""s"""
_STIFFNESS, _DAMPING = (max(getattr(motor, name) for motor in MOTORS.values()) for name in ("stiffness", "damping"))
"""N·m/rad and N·m·s/rad: the most that any motor takes."""


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
    exact = min(wiring.limit, actions.clip)
    limit = np.float32(exact)
    if limit > np.float64(exact):  # rounded up: the bound itself would be refused
        limit = np.nextafter(limit, np.float32(0.0))
    low, high = np.where(np.isfinite(raw), np.clip(raw, -limit, limit), [[-limit], [limit]]).astype(np.float32)
    is_useless = low >= high  # the whole range lies beyond the limit
    return Box(np.where(is_useless, -limit, low), np.where(is_useless, limit, high), dtype=np.float32)


def observation_space(wiring: PolicyWiring) -> Box:
    """Return the space of observations, shape (N,), without bounds."""
    return Box(-np.inf, np.inf, (wiring.layout.width,), dtype=np.float32)


def modes_action_space(description: RobotDescription, remote: bool) -> Space[Any]:
    """`Discrete`, an index into `INTENTS`; with `remote` a `Dict`.

    `intent` as before; `send`, 1 to send the command in this tick; `command`, shape (5, n), the fields of an
    `MITCommand` in their order.
    """
    intent = Discrete(len(INTENTS))
    if not remote:
        return intent
    low, high = _position_bounds(description)
    effort, ones = np.where(np.isfinite(description.effort_limit), description.effort_limit, 1e3), np.ones(len(low))
    bounds = {
        "position": (low, high),
        "velocity": (-100.0 * ones, 100.0 * ones),
        "effort": (-effort, effort),
        "stiffness": (0.0 * ones, _STIFFNESS * ones),
        "damping": (0.0 * ones, _DAMPING * ones),
    }
    least, most = (np.stack([bounds[name][end] for name in COMMAND_FIELDS]) for end in (0, 1))
    command = Box(least, most, dtype=np.float64)
    return Dict({"intent": intent, "send": Discrete(2), "command": command})


def modes_observation_space(description: RobotDescription) -> Dict:
    """State, mode, standby progress and safety; what each value is, `modes_observation` says."""
    low, high = _position_bounds(description)
    both = description.standby_controller_a, description.standby_controller_b
    n, effort = len(low), np.where(np.isfinite(description.effort_limit), description.effort_limit, np.float64(1e6))

    def box(bound: float, *shape: int, least: float | None = None) -> Box:
        return Box(-bound if least is None else least, bound, shape, dtype=np.float64)

    return Dict(
        {
            "joint_position": Box(low, high, dtype=np.float64),
            "joint_velocity": box(_SPEED, n),
            "joint_effort": Box(-effort, effort, dtype=np.float64),
            "joint_age": box(_OLD, n, least=0.0),
            "imu_quaternion": box(_ROUNDING, 4),
            "imu_angular_velocity": box(_SPEED, 3),
            "imu_linear_acceleration": box(_ACCELERATION, 3),
            "mode": Discrete(len(Mode)),
            "standby_segment": Discrete(max(len(standby.segment_durations) for standby in both) + 1),
            "standby_progress": box(1.0, 1, least=0.0),
            "standby_finished": Discrete(2),
            "safety_level": Discrete(len(SafetyLevel)),
            "safety_flags": MultiBinary(len(_FLAGS)),
        }
    )


def modes_observation(state: MITState, output: TickOutput | None, safety: tuple[SafetyStatus, ...]) -> dict[str, Any]:
    """Return what the stack shows.

    Args:
        state: the robot's report: fields of `MITState`, shape (n,), (4,) or (3,), in their units.
        output: of the latest tick; None before the first. Mode as a number; of standby the segment's number (from 1, 0
            outside of STANDBY), its progress [0, 1] and whether it has finished.
        safety: of all sources: level as a number, and one 0 or 1 for each flag in the order of their bits.
    """
    merged = merge_safety(safety)
    standby = None if output is None else output.standby
    return {
        **{name: np.array(getattr(state, name)) for name in _STATE},
        "mode": np.int64(Mode.ZERO_TORQUE if output is None else output.control_mode.mode),
        "standby_segment": np.int64(0 if standby is None else standby.current_segment + 1),
        "standby_progress": np.array([0.0 if standby is None else standby.progress]),
        "standby_finished": np.int64(standby is not None and standby.is_finished),
        "safety_level": np.int64(merged.level),
        "safety_flags": np.array([bool(merged.flags & flag) for flag in _FLAGS], dtype=np.int8),
    }


def _position_bounds(description: RobotDescription) -> tuple[FloatArray, FloatArray]:
    low, high = description.lower - _BEYOND_STOP, description.upper + _BEYOND_STOP
    return np.where(np.isfinite(low), low, -_ANY_POSITION), np.where(np.isfinite(high), high, _ANY_POSITION)
