"""What an operator can ask of the control stack, and what the stack shows: the spaces of `ModesEnv`."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from humanoid_sim.controllers.fsm import merge_safety
from humanoid_sim.messages import Intent, Mode, SafetyFlag, SafetyLevel, SafetyStatus, TickOutput
from humanoid_sim.mit import COMMAND_FIELDS, FloatArray, MITState
from humanoid_sim.robots.motors import MOTORS
from humanoid_sim.robots.schema import RobotDescription

__all__ = ["INTENTS", "modes_action_space", "modes_observation", "modes_observation_space"]

INTENTS: tuple[Intent | None, ...] = (None, *Intent)
"""By the action's number: 0 asks for nothing."""

_FLAGS = tuple(SafetyFlag)
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


def modes_action_space(description: RobotDescription, remote: bool) -> spaces.Space[Any]:
    """`Discrete`, an index into `INTENTS`; with `remote` a `Dict`.

    `intent` as before; `send`, 1 to send the command in this tick; `command`, shape (5, n), the fields of an
    `MITCommand` in their order.
    """
    intent = spaces.Discrete(len(INTENTS))
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
    command = spaces.Box(least, most, dtype=np.float64)
    return spaces.Dict({"intent": intent, "send": spaces.Discrete(2), "command": command})


def modes_observation_space(description: RobotDescription) -> spaces.Dict:
    """State, mode, standby progress and safety; what each value is, `modes_observation` says."""
    low, high = _position_bounds(description)
    n, effort = len(low), np.where(np.isfinite(description.effort_limit), description.effort_limit, np.float64(1e6))

    def box(bound: float, *shape: int, least: float | None = None) -> spaces.Box:
        return spaces.Box(-bound if least is None else least, bound, shape, dtype=np.float64)

    return spaces.Dict(
        {
            "joint_position": spaces.Box(low, high, dtype=np.float64),
            "joint_velocity": box(_SPEED, n),
            "joint_effort": spaces.Box(-effort, effort, dtype=np.float64),
            "joint_age": box(_OLD, n, least=0.0),
            "imu_quaternion": box(1.001, 4),
            "imu_angular_velocity": box(_SPEED, 3),
            "imu_linear_acceleration": box(_ACCELERATION, 3),
            "mode": spaces.Discrete(len(Mode)),
            "standby_segment": spaces.Discrete(_segments(description) + 1),
            "standby_progress": box(1.0, 1, least=0.0),
            "standby_finished": spaces.Discrete(2),
            "safety_level": spaces.Discrete(len(SafetyLevel)),
            "safety_flags": spaces.MultiBinary(len(_FLAGS)),
        }
    )


def modes_observation(state: MITState, output: TickOutput | None, safety: tuple[SafetyStatus, ...]) -> dict[str, Any]:
    """What the stack shows.

    Args:
        state: the robot's report: fields of `MITState`, shape (n,), (4,) or (3,), in their units.
        output: of the latest tick; None before the first. Mode as a number; of standby the segment's number (from 1, 0
            outside of STANDBY), its progress [0, 1] and whether it has finished.
        safety: of all sources: level as a number, and one 0 or 1 for each flag in the order of their bits.
    """
    merged = merge_safety(safety)
    standby = None if output is None else output.standby
    return {
        "joint_position": np.array(state.joint_position),
        "joint_velocity": np.array(state.joint_velocity),
        "joint_effort": np.array(state.joint_effort),
        "joint_age": np.array(state.joint_age),
        "imu_quaternion": np.array(state.imu_quaternion),
        "imu_angular_velocity": np.array(state.imu_angular_velocity),
        "imu_linear_acceleration": np.array(state.imu_linear_acceleration),
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


def _segments(description: RobotDescription) -> int:
    return max(
        len(standby.segment_durations)
        for standby in (description.standby_controller_a, description.standby_controller_b)
    )
