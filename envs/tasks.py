"""Tasks of environments: which rows of `step_metrics` are rewarded, which end an episode, and what is commanded.

A reward is `policy_dt` times the sum of weight (1/s) times value: an episode earns the same at any policy rate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import InputError, require_known
from humanoid_sim.evaluation.step import StepContext, StepSample
from humanoid_sim.evaluation.step_metrics import METRICS, Values
from humanoid_sim.mit import BoolArray, FloatArray

if TYPE_CHECKING:
    from humanoid_sim.envs.config import PolicyEnvConfig

_COMMAND_SECONDS = 5.0  # that a velocity command holds
_STANDING = 0.1  # share of the velocity commands that are zero
_RANGES = np.array([[-1.0, 1.0], [-0.5, 0.5], [-1.0, 1.0]])  # m/s, m/s, rad/s, where the contract has none
_EPISODE_SECONDS = 20.0  # where neither a motion nor the configuration says how long
_ANCHORED = ("anchor_position", "anchor_orientation")


@dataclass(frozen=True, slots=True)
class TaskKind:
    """A task, for any robot that it fits."""

    rewards: Mapping[str, float]  # weights, 1/s, of rows of `METRICS`, beside those of `_EVERY`
    reference: str = ""  # term of the reference that it follows, to the motion's end; empty: none, for a time
    is_commanded: bool = False  # velocity commands are drawn


_EVERY = {"action_change": -0.02, "effort_share": -0.05, "joint_stops": -2.0}
_TRACKING = {"body_position": 1.0, "body_orientation": 0.5}
_MOTION = {"joint_position": 1.0, "anchor_position": 0.5, "anchor_orientation": 0.5}
_PIANO = {"recall": 0.5, "no_wrong_key": 0.5, "power": -0.0005}
_VELOCITY = {"linear_velocity": 1.0, "yaw_rate": 0.5}
_UPRIGHT = {"vertical_velocity": -1.0, "rocking": -0.05, "lean": -1.0, "alive": 0.5}
TASKS: Mapping[str, TaskKind] = {
    "tracking": TaskKind(_TRACKING, "motion_body_pos_b"),
    "motion": TaskKind(_MOTION, "reference_joint_pos"),
    "piano": TaskKind(_PIANO, "target_keys"),
    "velocity": TaskKind({**_VELOCITY, **_UPRIGHT}, is_commanded=True),
    "balance": TaskKind({"alive": 1.0, "joint_speed": -0.001}),
}


class Judgement(NamedTuple):
    """Judgement of a policy step by a task; every array is shape (...)."""

    reward: FloatArray  # the sum of the terms
    terms: Mapping[str, FloatArray]  # by reward term: weight times value times `policy_dt`
    terminated: BoolArray  # the robot has failed
    truncated: BoolArray  # the motion has ended, or the time is up


class Task:
    """One task for one robot and contract. Its methods are functions of their arguments."""

    def __init__(self, config: PolicyEnvConfig, context: StepContext) -> None:
        """Choose rewards and terminations. Raises `InputError` for what robot and motion do not have."""
        self.context = context
        contract, reference, robot = context.contract, context.reference, context.description
        kind = _kind(config.task, context)
        self._terms: list[tuple[str, float, Values]] = []
        for name, given in {**kind.rewards, **_EVERY, **config.rewards}.items():
            if name in _ANCHORED and name not in config.rewards and "motion with an anchor" not in context.parts:
                continue
            weight, function = (given[0], _of_sample(given[1])) if isinstance(given, tuple) else (given, None)
            if not math.isfinite(weight):
                raise InputError(f"rewards: weight of {name} is {weight}, expected a finite number")
            if weight:
                rate = weight * contract.policy_dt
                self._terms.append((name, rate, self._metric("rewards", name) if function is None else function))
        ends = config.terminations
        if ends is None:
            follows = kind.reference in ("motion_body_pos_b", "reference_joint_pos") and "motion" in context.parts
            ends = (*(["strayed"] if follows else []), *(["fallen"] if robot.is_floating else []))
        self._ends = [self._metric("terminations", name) for name in ends]
        self._follows_motion = bool(kind.reference)
        steps = config.max_episode_steps or round(_EPISODE_SECONDS / contract.policy_dt)
        if kind.reference:
            longest = reference.frame_count - 1
            steps = min(config.max_episode_steps or longest, longest)
        self.episode_steps = steps  # policy steps after which an episode is truncated
        ranges = _RANGES if contract.command_ranges is None else contract.command_ranges
        self._low, self._width = ranges[:, 0], ranges[:, 1] - ranges[:, 0]
        self._hold = max(round(_COMMAND_SECONDS / contract.policy_dt), 1)
        self._command_count = -(-self.episode_steps // self._hold) if kind.is_commanded else 0
        self.command_draws = 4 * self._command_count  # random numbers that the commands of an episode take

    def _metric(self, where: str, name: str) -> Values:
        require_known("metric", [name], METRICS, f"{where}: ")
        row, robot = METRICS[name], self.context.description.name
        if row.needs not in self.context.parts:
            raise InputError(f"{name}: needs a {row.needs}, which robot '{robot}' with this policy does not have")
        return row.values

    def commands(self, numbers: FloatArray) -> FloatArray:
        """Return the velocity commands of an episode, shape (..., k, 3), for random numbers (..., command_draws)."""
        if not self.command_draws:
            return np.zeros((*numbers.shape[:-1], 1, 3))
        drawn = numbers.reshape(*numbers.shape[:-1], self._command_count, 4)
        return np.where(drawn[..., 3:] < _STANDING, 0.0, self._low + self._width * drawn[..., :3])

    def command(self, commands: FloatArray, step: int | npt.NDArray[np.integer]) -> FloatArray:
        """Return the command in force after `step` policy steps, shape (..., 3)."""
        if commands.shape[-2] == 1:
            return commands[..., 0, :]
        i = np.minimum(np.asarray(step) // self._hold, commands.shape[-2] - 1)
        command: FloatArray = np.take_along_axis(commands, i[..., None, None], axis=-2)[..., 0, :]
        return command

    def judge(self, sample: StepSample) -> Judgement:
        """Return the reward, and whether the episode is over."""
        terms = {name: rate * values(self.context, sample) for name, rate, values in self._terms}
        reward = sum(terms.values(), start=np.zeros(sample.torque.shape[:-1]))
        is_last = np.asarray(sample.step) >= self.episode_steps
        if self._follows_motion:
            is_last = is_last | (np.asarray(sample.frame) >= self.context.reference.frame_count - 1)
        return Judgement(reward, terms, self.failed(sample), is_last)

    def failed(self, sample: StepSample) -> BoolArray:
        """Return which robots have failed, shape (...)."""
        failed = np.zeros(sample.torque.shape[:-1], dtype=np.bool_)
        for values in self._ends:
            failed = failed | (values(self.context, sample) > 0.0)
        return failed


def _kind(name: str, context: StepContext) -> TaskKind:
    """Return the task of that name; `auto`: the one that the contract and its motion were made for."""
    require_known("task", [name], ("auto", *TASKS), "task: ")
    terms = context.reference.terms
    if name == "auto":
        walks = context.description.is_floating and context.contract.task_type == "locomotion"
        followed = (name for name, kind in TASKS.items() if kind.reference in terms)
        name = next(followed, "velocity" if walks else "balance")
    kind = TASKS[name]
    if kind.reference and kind.reference not in terms:
        raise InputError(f"task: {name} needs a motion with {kind.reference}, and the policy's has none")
    return kind


def _of_sample(function: Callable[[StepSample], FloatArray | float]) -> Values:
    return lambda _, sample: np.broadcast_to(np.float64(function(sample)), sample.torque.shape[:-1])


def require_finite(reward: FloatArray, terms: Mapping[str, FloatArray]) -> None:
    """Raise `InputError` naming the term if a reward, shape (...), is not finite."""
    # of one robot by `math`: NumPy takes 20 times as long for a single number
    if math.isfinite(reward) if reward.ndim == 0 else np.isfinite(reward).all():
        return
    names = [name for name, values in terms.items() if not np.isfinite(values).all()]
    raise InputError(f"rewards: {', '.join(names) or 'their sum'} is not finite")
