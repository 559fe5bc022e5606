"""Policies that behave, and policies that misbehave."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from humanoid_sim.controllers.policy_step import ACTION_LIMIT

Answer = Callable[[npt.NDArray[np.float32], int], Any]
"""`(observation of shape (N,), reference frame) -> action`, which need not be one."""


class ScriptedPolicy:
    """Answers as it is told to at the moment, and keeps what it was asked."""

    def __init__(self, answer: Answer) -> None:
        self.answer = answer
        """Replace it at any time."""
        self.calls: list[tuple[npt.NDArray[np.float32], int]] = []
        """Observation and frame of each call."""

    def __call__(self, observation: npt.NDArray[np.float32], frame: int) -> Any:
        """Whatever `answer` gives at the moment."""
        self.calls.append((observation, frame))
        return self.answer(observation, frame)


@dataclass(frozen=True)
class Misbehaviour:
    """A policy with one fault; a failing example shows its name."""

    name: str
    answer: Answer = field(repr=False)

    def __call__(self, observation: npt.NDArray[np.float32], frame: int) -> Any:
        """Whatever is wrong with this one."""
        return self.answer(observation, frame)


def well_behaved(action_count: int) -> Answer:
    """Actions of shape (m,) within [-1, 1] that depend on everything the policy sees."""
    spread = 0.1 * np.arange(action_count)

    def answer(observation: npt.NDArray[np.float32], frame: int) -> npt.NDArray[np.float64]:
        action: npt.NDArray[np.float64] = np.tanh(observation.sum(dtype=np.float64) + spread * frame)
        return action

    return answer


def misbehaviours(action_count: int, action_limit: float = ACTION_LIMIT) -> Mapping[str, Misbehaviour]:
    """Policies whose answers no controller may pass on, by what is wrong with them.

    Args:
        action_count: m, the width of a right answer.
        action_limit: the largest magnitude that the controller under test accepts.
    """

    def one(i: int, value: float) -> Answer:
        answer = [0.0] * action_count
        answer[i] = value
        return lambda *_: answer

    def fails(*_: object) -> Any:
        raise RuntimeError("no such tensor")

    def writes(observation: npt.NDArray[np.float32], *_: object) -> Any:
        return observation.fill(0.0)

    zeros = [0.0] * action_count
    answers: dict[str, Answer] = {
        "NaN": one(-1, np.nan),
        "infinite": one(0, -np.inf),
        "beyond float32": one(0, 1e300),
        "over the limit": one(0, action_limit + 0.5),
        "too short": lambda *_: zeros[1:],
        "too long": lambda *_: [*zeros, 0.0],
        "a batch": lambda *_: [zeros],
        "a scalar": lambda *_: 0.0,
        "ragged": lambda *_: [[0.0], [0.0, 1.0]],
        "text": lambda *_: "left",
        "texts of numbers": lambda *_: [str(value) for value in zeros],
        "integers": lambda *_: [0] * action_count,
        "a record": lambda *_: np.zeros(action_count, dtype=[("left", np.float32)]),
        "nothing": lambda *_: None,
        "raises": fails,
        "writes": writes,
    }
    return {name: Misbehaviour(name, answer) for name, answer in answers.items()}


def policies_that_misbehave(action_count: int, action_limit: float = ACTION_LIMIT) -> SearchStrategy[Misbehaviour]:
    """One of `misbehaviours`."""
    return st.sampled_from(list(misbehaviours(action_count, action_limit).values()))
