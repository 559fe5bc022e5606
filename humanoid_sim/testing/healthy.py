"""A robot on which nothing is wrong, and policies that behave or misbehave."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import ANCHOR_POSE, Extern, FloatArray, MITState

_UPRIGHT_AT_ORIGIN = np.array([0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0])  # m and w x y z

Answer = Callable[[npt.NDArray[np.float32], int], Any]  # (observation of shape (N,), frame) -> action, or anything


def healthy_externs(widths: Mapping[str, int], time: float) -> dict[str, Extern]:
    """Live inputs that arrived at `time` s, by name and width: nothing commanded or pressed, upright at the origin."""
    return {
        name: Extern(_UPRIGHT_AT_ORIGIN if name == ANCHOR_POSE and width == 7 else np.zeros(width), time)
        for name, width in widths.items()
    }


def healthy_state(
    position: Sequence[float] | FloatArray, time: float = 0.0, externs: Mapping[str, int] = MappingProxyType({})
) -> MITState:
    """Return a robot at rest and upright at `time` s, its joints at `position` (n,), rad."""
    zeros = np.zeros(len(position))
    return MITState(
        time=time,
        joint_position=np.array(position, dtype=np.float64),
        joint_velocity=zeros,
        joint_effort=zeros,
        joint_age=zeros,
        imu_quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
        imu_angular_velocity=np.zeros(3),
        imu_linear_acceleration=np.array([0.0, 0.0, 9.81]),
        extern=healthy_externs(externs, time),
    )


class ScriptedPolicy:
    """Answers as `answer` does at the moment, and keeps the observation and frame of each call."""

    def __init__(self, answer: Answer) -> None:
        self.answer = answer
        self.calls: list[tuple[npt.NDArray[np.float32], int]] = []

    def __call__(self, observation: npt.NDArray[np.float32], frame: int) -> Any:
        self.calls.append((observation, frame))
        return self.answer(observation, frame)


def well_behaved(action_count: int) -> Answer:
    """Return a policy whose actions (m,) are within [-1, 1] and depend on everything that it sees."""
    spread = 0.1 * np.arange(action_count)
    return lambda observation, frame: np.tanh(observation.sum(dtype=np.float64) + spread * frame)


def misbehaviours(action_count: int, action_limit: float = 100.0) -> Mapping[str, Answer]:
    """Return policies of `action_count` actions whose answers no controller may pass on, by what is wrong."""
    zeros = [0.0] * action_count

    def fails(*_: object) -> Any:
        raise RuntimeError("no such tensor")

    return {
        "NaN": lambda *_: [*zeros[1:], np.nan],
        "infinite": lambda *_: [-np.inf, *zeros[1:]],
        "beyond float32": lambda *_: [1e300, *zeros[1:]],
        "over the limit": lambda *_: [action_limit + 0.5, *zeros[1:]],
        "too short": lambda *_: zeros[1:],
        "too long": lambda *_: [*zeros, 0.0],
        "a batch": lambda *_: [zeros],
        "text": lambda *_: "left",
        "integers": lambda *_: [0] * action_count,
        "nothing": lambda *_: None,
        "raises": fails,
        "writes": lambda observation, _: observation.fill(0.0),
    }
