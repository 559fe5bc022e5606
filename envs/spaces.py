"""The spaces of the environments, and what their callers give."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary

from humanoid_sim.controllers.fsm import merge_safety
from humanoid_sim.controllers.policy_step import PolicyWiring
from humanoid_sim.errors import InputError, blaming, require_known
from humanoid_sim.messages import Intent, Mode, SafetyFlag, SafetyLevel, SafetyStatus, TickOutput
from humanoid_sim.mit import Float32Array, FloatArray, MITState
from humanoid_sim.robots.schema import RobotDescription

INTENTS: tuple[Intent | None, ...] = (None, *Intent)
"""By the number of an action of `ModesEnv`: 0 asks for nothing."""

_FLAGS = tuple(SafetyFlag)
_STATE = tuple(field.name for field in fields(MITState) if field.name not in ("time", "extern"))


def action_space(wiring: PolicyWiring, description: RobotDescription) -> Box:
    """Return the space of raw actions, shape (m,).

    Targets from `lower - effort_limit / K_p` to `upper + effort_limit / K_p`: beyond, an action changes nothing. Where
    a joint has no limits or no stiffness, up to the limit of the raw action.
    """
    contract, actions, driven = wiring.contract, wiring.action_map, wiring.action_map.indices
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = description.effort_limit[driven] / actions.stiffness[driven]
        ends = np.stack([description.lower[driven] - reach, description.upper[driven] + reach])
        raw = np.sort((ends - actions.offset) / contract.action_scale, axis=0)
    limit = np.float32(min(contract.action_limit, contract.action_clip))
    low, high = np.where(np.isfinite(raw), np.clip(raw, -limit, limit), [[-limit], [limit]]).astype(np.float32)
    return Box(low, high, dtype=np.float32)


def observation_space(wiring: PolicyWiring) -> Box:
    """Return the space of observations, shape (N,)."""
    return Box(-np.inf, np.inf, (wiring.layout.width,), dtype=np.float32)


def raw_action(action: Any, space: Any) -> Float32Array:
    """Return a copy of an action, or of a batch of them. Raises `InputError` unless it has the space's shape."""
    with np.errstate(over="ignore"):  # becomes infinite, and is refused
        raw = np.array(action, dtype=np.float32)
    if raw.shape != space.shape:
        raise InputError(f"action: has shape {raw.shape}, expected {space.shape}")
    return raw


def reset_options(options: Mapping[str, Any] | None, widths: Mapping[str, int]) -> dict[str, FloatArray]:
    """Return the options of a reset, shape (width,) each, or of commands (k, 3).

    Raises `InputError` for another one, or for what is not finite or has another shape.
    """
    require_known("option", options or (), widths, "reset: ")
    given: dict[str, FloatArray] = {}
    for name, value in (options or {}).items():
        with blaming(f"reset: {name} is {value!r}, expected {widths[name]} finite numbers", (ValueError, TypeError)):
            given[name] = np.asarray(value, dtype=np.float64)
            shape = given[name].shape[1:] if given[name].ndim == 2 and name == "command" else given[name].shape
            if shape != (widths[name],) or not np.isfinite(given[name]).all():
                raise ValueError(f"has shape {given[name].shape}, or NaN")
    return given


def velocity_option(value: FloatArray, count: int | None = None) -> FloatArray:
    """Return a reset's commands: one or several rows, shape (k, 3); with `count`, one for each environment, (count, 3).

    A row is vx, vy in m/s and yaw rate in rad/s. Raises `InputError` for another number of rows.
    """
    command = np.atleast_2d(value)
    rows = len(command) if count is None else count
    if len(command) not in (1, rows):
        raise InputError(f"reset: command has shape {command.shape}, expected vx, vy and yaw rate, or {rows} such rows")
    return np.broadcast_to(command, (rows, 3))


def modes_observation_space(description: RobotDescription) -> Dict:
    """Return the space of `modes_observation`."""
    n = description.joint_count
    both = description.standby_controller_a, description.standby_controller_b
    widths = {name: n for name in _STATE if name.startswith("joint")}
    widths |= {"imu_quaternion": 4, "imu_angular_velocity": 3, "imu_linear_acceleration": 3, "standby_progress": 1}
    return Dict(
        {
            **{name: Box(-np.inf, np.inf, (width,), dtype=np.float64) for name, width in widths.items()},
            "mode": Discrete(len(Mode)),
            "standby_segment": Discrete(max(len(standby.segment_durations) for standby in both) + 1),
            "standby_finished": Discrete(2),
            "safety_level": Discrete(len(SafetyLevel)),
            "safety_flags": MultiBinary(len(_FLAGS)),
        }
    )


def modes_observation(state: MITState, output: TickOutput | None, safety: tuple[SafetyStatus, ...]) -> dict[str, Any]:
    """Return an operator's view: fields of the report, of the latest tick's output (None before the first), of safety.

    NaN, of a simulation that has diverged, is 0. The standby's segment counts from 1.
    """
    merged = merge_safety(safety)
    standby = None if output is None else output.standby
    return {
        **{name: np.nan_to_num(getattr(state, name)) for name in _STATE},
        "mode": np.int64(Mode.ZERO_TORQUE if output is None else output.control_mode.mode),
        "standby_segment": np.int64(0 if standby is None else standby.current_segment + 1),
        "standby_progress": np.array([0.0 if standby is None else standby.progress]),
        "standby_finished": np.int64(standby is not None and standby.is_finished),
        "safety_level": np.int64(merged.level),
        "safety_flags": np.array([bool(merged.flags & flag) for flag in _FLAGS], dtype=np.int8),
    }
