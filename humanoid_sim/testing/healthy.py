"""A robot on which nothing is wrong, and policies that behave or misbehave."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.policy_step import ACTION_LIMIT
from humanoid_sim.messages import Intent, RemoteCommand, TickInput
from humanoid_sim.mit import ANCHOR_POSE, Extern, FloatArray, MITState

_UPRIGHT_AT_ORIGIN = (0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0)  # m and w x y z
_NO_EXTERNS: Mapping[str, int] = {}

Answer = Callable[[npt.NDArray[np.float32], int], Any]
"""`(observation of shape (N,), reference frame) -> action`, which need not be one."""


def healthy_externs(widths: Mapping[str, int], time: float) -> dict[str, Extern]:
    """Live inputs that arrived at `time` s, by name and width: nothing commanded or pressed, upright at the origin."""
    values = {name: np.zeros(width) for name, width in widths.items()}
    if widths.get(ANCHOR_POSE) == len(_UPRIGHT_AT_ORIGIN):
        values[ANCHOR_POSE] = np.array(_UPRIGHT_AT_ORIGIN)
    return {name: Extern(value, time) for name, value in values.items()}


def healthy_state(
    position: Sequence[float] | FloatArray, time: float = 0.0, externs: Mapping[str, int] = _NO_EXTERNS
) -> MITState:
    """Return a robot at rest and upright at `time` s, its joints at `position` (n,), rad."""
    n = len(position)
    return MITState(
        time=time,
        joint_position=np.array(position, dtype=np.float64),
        joint_velocity=np.zeros(n),
        joint_effort=np.zeros(n),
        joint_age=np.zeros(n),
        imu_quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
        imu_angular_velocity=np.zeros(3),
        imu_linear_acceleration=np.array([0.0, 0.0, 9.81]),
        extern=healthy_externs(externs, time),
    )


def healthy_tick(
    position: Sequence[float] | FloatArray,
    time: float,
    *intents: Intent,
    remote: RemoteCommand | None = None,
    externs: Mapping[str, int] = _NO_EXTERNS,
) -> TickInput:
    """One tick of such a robot, with what an operator and a sender of remote commands ask of it."""
    return TickInput(healthy_state(position, time, externs), intents=intents, remote=remote)


class ScriptedPolicy:
    """Answers as `answer` does at the moment, and keeps the observation and frame of each call."""

    def __init__(self, answer: Answer) -> None:
        self.answer = answer
        self.calls: list[tuple[npt.NDArray[np.float32], int]] = []

    def __call__(self, observation: npt.NDArray[np.float32], frame: int) -> Any:
        """Return the present answer."""
        self.calls.append((observation, frame))
        return self.answer(observation, frame)


def well_behaved(action_count: int) -> Answer:
    """Actions of shape (m,) within [-1, 1] that depend on everything the policy sees."""
    spread = 0.1 * np.arange(action_count)

    def answer(observation: npt.NDArray[np.float32], frame: int) -> npt.NDArray[np.float64]:
        action: npt.NDArray[np.float64] = np.tanh(observation.sum(dtype=np.float64) + spread * frame)
        return action

    return answer


def misbehaviours(action_count: int, action_limit: float = ACTION_LIMIT) -> Mapping[str, Answer]:
    """Policies whose answers no controller may pass on, by what is wrong with them; m is `action_count`."""
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
