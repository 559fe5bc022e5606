"""Base of every task, the terms of every reward (little effort, smooth actions, no joint stops), and standing still."""

from __future__ import annotations

import math
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from numbers import Real
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.errors import InputError, reason_of, require_known
from humanoid_sim.evaluation.errors import total
from humanoid_sim.evaluation.failure import describe_fall, has_fallen
from humanoid_sim.evaluation.step import StepSample
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.schema import RobotDescription

BoolArray = npt.NDArray[np.bool_]
RewardTerm = tuple[float, Callable[[StepSample], FloatArray | float]]
"""A weight, 1/s per unit of the term, and the term's value of a policy step: shape (...), or a number for all."""

_FORM = "expected (weight, function)"
_STOP_MARGIN = 0.05
"""rad from a joint's limit within which it counts as at its stop."""


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """Start of an episode, and what is asked for in it. The base stands on its feet where the robot starts."""

    joint_position: FloatArray
    """Shape (..., n), rad, robot's order."""
    joint_velocity: FloatArray
    """Shape (..., n), rad/s."""
    base_yaw: FloatArray
    """Shape (...), rad, about the vertical, on top of the robot's own start; only floating bases turn."""
    commands: FloatArray
    """Shape (..., k, 3), the velocity commands one after the other: vx, vy in m/s, yaw rate in rad/s, heading frame."""
    frame: npt.NDArray[np.integer] | None = None
    """Frame of the reference that is shown first, shape (...); None: 0."""
    base_pose: FloatArray | None = None
    """Shape (..., 7), m and w x y z, world frame, of a floating base instead of all that; rows of NaN, or None, where
    it stands."""
    base_velocity: FloatArray | None = None
    """Shape (..., 6), m/s, world frame, and rad/s, base frame, where `base_pose` says where it is."""

    @property
    def pose(self) -> dict[str, FloatArray | None]:
        """Return where the robot begins, as `StartPose.arrays` takes it."""
        names = "joint_position", "joint_velocity", "base_yaw", "base_pose", "base_velocity"
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """Judgement of a policy step by a task; every array is shape (...)."""

    reward: FloatArray
    """The sum of the terms, dimensionless."""
    terms: Mapping[str, FloatArray]
    """Shares of the terms in the reward: its weight (1/s per unit of the term) times its value times `policy_dt`."""
    terminated: BoolArray
    """The robot has failed at the task."""
    truncated: BoolArray
    """The task is over: the motion has ended, or the time is up."""


class Task(ABC):
    """One task for one robot and contract. Stateless: all methods are functions of their arguments.

    Rewards are rates: a term of weight 1 that is 1 throughout adds 1 per second, whatever the policy's period is. Terms
    of every task, and their weights unless others are given:

    ============ ====== ======== ==================================================================================
    term         weight unit     value
    ============ ====== ======== ==================================================================================
    action_rate  -0.02  action²  squared change of the raw action, summed over its values
    effort       -0.05  1        squared torque as a share of the joint's effort limit, summed over the joints
    joint_stops  -2.0   rad      how far joints are beyond their limits less 0.05 rad, summed over the joints
    ============ ====== ======== ==================================================================================
    """

    WEIGHTS: ClassVar[Mapping[str, float]] = MappingProxyType(
        {"action_rate": -0.02, "effort": -0.05, "joint_stops": -2.0}
    )
    """1/s per unit of each term."""
    FOLLOWS_MOTION: ClassVar[bool] = False
    """True of a task that ends with its motion, not after a time."""
    REFERENCE: ClassVar[str] = ""
    """Term of the reference without which it means nothing; `auto` takes the first task whose term is there."""

    bodies: tuple[str, ...] = ()
    """Bodies, with a site of the same name each, whose poses and velocities the task looks at beside the motion's."""

    def __init__(
        self,
        description: RobotDescription,
        contract: PolicyContract,
        reference: MotionReference,
        *,
        standing_height: float = 0.0,
        weights: Mapping[str, float] | None = None,
        episode_seconds: float = 20.0,
        joint_noise: float = 0.05,
        velocity_noise: float = 0.1,
        rewards: Mapping[str, RewardTerm] | None = None,
    ) -> None:
        """Prepare for a robot and a contract.

        Raises `InputError` if a number is not finite, a weight is for a term that the task does not have, or a further
        term is not a weight with a function.

        Args:
            contract: of the policy; its joints are the robot's.
            standing_height: m, of the centre of mass above the floor where the robot stands; 0 for a fixed base.
            weights: of terms that should have another weight than the task gives them, 1/s per unit of the term.
            episode_seconds: s after which an episode is truncated; tasks that follow a motion end with it instead.
            joint_noise: rad by which each joint may start off the contract's default pose.
            velocity_noise: rad/s by which each joint may start off rest.
            rewards: further terms by name, or others in place of the task's own. One function of a `StepSample` serves
                one robot and a batch.
        """
        numbers = {"episode_seconds": episode_seconds, "joint_noise": joint_noise, "velocity_noise": velocity_noise}
        for name, value in numbers.items():
            if not (finite(value) and value >= 0.0):
                raise InputError(f"{name}: is {value}, expected a finite number >= 0")
        self._rewards = checked_terms(rewards)
        own = {name: weight for name, (weight, _) in self._rewards.items()}
        known = {**self.WEIGHTS, **own}
        require_known("reward term", weights or (), known, "weights: ")
        self.weights: Mapping[str, float] = MappingProxyType({**known, **(weights or {})})
        """1/s per unit of each term."""
        for name, value in self.weights.items():
            if not finite(value):
                raise InputError(f"weights: {name} is {value}, expected a finite number")
        self._rate = {name: weight * contract.policy_dt for name, weight in self.weights.items()}
        self.contract = contract
        self.reference = reference
        longest = max(reference.lengths or (reference.frame_count,)) - 1
        self.episode_steps = longest if self.FOLLOWS_MOTION else max(round(episode_seconds / contract.policy_dt), 1)
        """Policy steps after which an episode is truncated; of tasks that follow a motion, those to its last frame."""
        self._is_floating = description.is_floating
        self._standing_height = standing_height
        self._lower, self._upper = np.array(description.lower), np.array(description.upper)
        self._soft_lower, self._soft_upper = self._lower + _STOP_MARGIN, self._upper - _STOP_MARGIN
        self._inverse_effort = 1.0 / np.array(description.effort_limit)
        order = joint_indices(description.joint_names, contract.joint_names, "joints of the robot")
        self._pose = np.clip(contract.default_joint_pos[order], self._lower, self._upper)
        self._noise = joint_noise, velocity_noise
        self.draws = 2 * len(order) + 1
        """Random numbers that one start takes."""
        self._prepare(description)

    def _prepare(self, description: RobotDescription) -> None:
        """Look up what the task needs beside this, and refuse a robot, contract or motion that lacks it."""
        del description

    def start(self, numbers: FloatArray, around: tuple[FloatArray, FloatArray, BoolArray] | None = None) -> Start:
        """Return the start that uniform random numbers in [0, 1), shape (..., draws), stand for.

        Joints start around the contract's default pose, within their limits; a floating base has any heading.

        Args:
            around: joint positions, rad, and velocities, rad/s, (..., n), around which they start instead, of those
                robots where the third, (...), says so.
        """
        n = len(self._pose)
        pose, motion = self._pose, np.zeros(n)
        if around is not None:
            is_there = around[2][..., None]
            pose, motion = np.where(is_there, around[0], pose), np.where(is_there, around[1], motion)
        spread = 2.0 * numbers - 1.0
        position, velocity = self._noise
        return Start(
            joint_position=np.clip(pose + position * spread[..., :n], self._lower, self._upper),
            joint_velocity=motion + velocity * spread[..., n : 2 * n],
            base_yaw=np.pi * spread[..., 2 * n] if self._is_floating else np.zeros(numbers.shape[:-1]),
            commands=self._commands(numbers[..., 2 * n + 1 :]),
        )

    def _commands(self, numbers: FloatArray) -> FloatArray:
        """Shape (..., 1, 3): to stay where it is, unless a task asks for more."""
        return np.zeros((*numbers.shape[:-1], 1, 3))

    def command(self, commands: FloatArray, step: int | npt.NDArray[np.integer]) -> FloatArray:
        """Give the velocity command in force after `step` policy steps, shape (..., 3); `commands` are the start's."""
        command: FloatArray = commands[..., 0, :]
        return command

    def judge(self, sample: StepSample) -> Judgement:
        """Reward, and whether the episode is over."""
        values, terminated = self._checked(sample)
        change = sample.action - sample.previous_action
        share = sample.torque * self._inverse_effort
        q = sample.state.joint_position
        beyond = np.maximum(np.maximum(self._soft_lower - q, q - self._soft_upper), 0.0)
        values |= {
            "action_rate": total(change * change),
            "effort": total(share * share),
            "joint_stops": total(beyond),
        }
        values |= {name: term_value(name, term, sample, share.shape[:-1]) for name, term in self._rewards.items()}
        if self._is_floating:
            assert sample.base is not None
            terminated = terminated | has_fallen(sample.base, self._standing_height)
        terms = {name: self._rate[name] * value for name, value in values.items()}
        reward = sum(terms.values(), start=np.zeros(()))  # one after the other: a batch adds in the same order
        return Judgement(reward, terms, terminated, self._is_over(sample))

    def _checked(self, sample: StepSample) -> tuple[dict[str, FloatArray], BoolArray]:
        """Return what `_measure` does, which may be a user's.

        Raises `InputError` if it fails, or does not give what it is to give; the line says where.
        """
        name, shape = type(self).__name__, sample.torque.shape[:-1]
        try:
            values, terminated = self._measure(sample)
            require_known("reward term", values, self._rate, f"task: {name}.WEIGHTS: ")
            for term, value in values.items():
                if np.shape(value) != shape:
                    raise InputError(f"task: {name}: '{term}' has shape {np.shape(value)}, expected {shape}")
            if np.shape(terminated) != shape or np.asarray(terminated).dtype != np.bool_:
                raise InputError(f"task: {name}: says {terminated!r} of failure, expected bools of shape {shape}")
        except InputError:
            raise
        except Exception as error:
            _, *inner = traceback.extract_tb(error.__traceback__)
            place = f" at {inner[0].filename}:{inner[0].lineno}" if inner else ""
            raise InputError(
                f"task: {name} fails{place}: {type(error).__name__}: {reason_of(error)}; its samples have "
                f"{sample.body_position.shape[-2]} bodies and {'no' if sample.base is None else 'a'} base"
            ) from error
        return values, terminated

    def describe_failure(self, sample: StepSample, i: int) -> str:
        """Return why robot `i` of a batch has failed in a step that `judge` terminated."""
        if sample.base is not None and np.asarray(has_fallen(sample.base, self._standing_height))[i]:
            return describe_fall(sample.base, self._standing_height, i)
        return self._describe_stray(sample, i)

    def _describe_stray(self, sample: StepSample, i: int) -> str:
        """Return how robot `i`, which has not fallen, has failed at the task; '' at one where it can only fall."""
        return ""

    @abstractmethod
    def _measure(self, sample: StepSample) -> tuple[dict[str, FloatArray], BoolArray]:
        """Return the values of the task's own terms, before their weights, and whether the robot has failed at it."""

    def _is_over(self, sample: StepSample) -> BoolArray:
        if self.FOLLOWS_MOTION:
            return np.asarray(sample.frame) >= self.reference.last(sample.frame)
        return np.asarray(sample.step) >= self.episode_steps


class BalanceTask(Task):
    """Stay up for as long as the episode lasts: for contracts whose goal no other task knows.

    ============== ====== ======== ================================================================================
    term           weight unit     value
    ============== ====== ======== ================================================================================
    alive          1.0    1        1
    joint_velocity -0.001 rad²/s²  squared joint velocity, summed over the joints
    ============== ====== ======== ================================================================================

    Terminated where a robot with a floating base has fallen, as `humanoid_sim.evaluation.failure` defines it.
    """

    WEIGHTS: ClassVar[Mapping[str, float]] = MappingProxyType({"alive": 1.0, "joint_velocity": -0.001, **Task.WEIGHTS})

    def _measure(self, sample: StepSample) -> tuple[dict[str, FloatArray], BoolArray]:
        velocity = sample.state.joint_velocity
        speed = total(velocity * velocity)
        return {"alive": np.ones_like(speed), "joint_velocity": speed}, np.zeros(speed.shape, dtype=np.bool_)


def checked_terms(rewards: Mapping[str, RewardTerm] | None) -> dict[str, RewardTerm]:
    """Return the terms by name. Raises `InputError` if one is not a weight with a function."""
    if not isinstance(rewards, Mapping | None):
        raise InputError(f"rewards: is {_kind(rewards)}, expected a (weight, function) by the name of each term")
    for name, term in (rewards or {}).items():
        if not isinstance(term, tuple | list) or len(term) != 2:
            raise InputError(f"rewards: {name} is {_kind(term)}, {_FORM}")
        if isinstance(term[0], bool) or not isinstance(term[0], Real) or not callable(term[1]):
            raise InputError(f"rewards: {name} is ({_kind(term[0])}, {_kind(term[1])}), {_FORM}")
    return dict(rewards or {})


def _kind(value: Any) -> str:
    if callable(value):
        return "a function"
    return f"{value}" if isinstance(value, Real) else f"a {type(value).__name__}"


def finite(value: Any) -> bool:
    """Return whether it is one finite number."""
    return isinstance(value, Real) and math.isfinite(value)


def term_value(name: str, term: RewardTerm, sample: StepSample, shape: tuple[int, ...]) -> FloatArray:
    """Return what a term gives for a policy step, shape (...).

    Raises `InputError` if it is neither a value for each robot, nor a number for all of them.
    """
    given = term[1](sample)
    if type(given) in (float, int):  # not NumPy's scalars: in a batch they are a sum over all robots
        return np.full(shape, given, dtype=np.float64)
    try:
        value = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"rewards: {name} gives {_kind(given)}, expected numbers") from None
    if value.shape != shape:
        raise InputError(f"rewards: {name} has shape {value.shape}, expected {shape}: one value for each robot")
    return value


def require_finite(reward: FloatArray, terms: Mapping[str, FloatArray]) -> None:
    """Refuse rewards that are not finite. Raises `InputError` if one is not; it names the term and the first robot.

    Args:
        reward: shape (...), 0 for robots that do not count.
        terms: what each adds to it, shape (...).
    """
    # of one robot by `math`: NumPy takes 20 times as long for a single number
    if math.isfinite(reward) if reward.ndim == 0 else np.isfinite(reward).all():
        return
    i = int(np.flatnonzero(~np.isfinite(np.ravel(reward)))[0])
    values = {name: float(np.ravel(term)[i]) for name, term in terms.items()}
    name, value = next(((n, v) for n, v in values.items() if not math.isfinite(v)), ("their sum", math.inf))
    raise InputError(f"rewards: {name} is {'nan' if math.isnan(value) else 'infinite'} in environment {i}")
