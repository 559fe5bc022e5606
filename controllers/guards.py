"""Guards: watch the joints in STANDBY, LOCOMOTION and REMOTE. A trip is a fault of the controller that drives them.

| guard | trips where, for its time and without a pause |
|---|---|
| following | K_p times the position error is near the effort limit, and the joint comes no nearer |
| limit | a joint is beyond its limits by more than a margin, and still pushed outward |
| speed | a joint is faster than its limit |
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import numpy as np

from humanoid_sim.mit import BoolArray, FloatArray, MITCommand, MITState

_FOLLOWING, _LIMIT, _SPEED = range(3)  # rows of `GuardMemory.held`
_LONGEST_STEP = 0.05  # s that one tick may add: a jump of the clock is not time that a joint was pressed
_STALE = 0.1  # s after which a joint that is silent is not judged any more
_ROUNDING = 1e-9  # s: times are decimal fractions that binary numbers round


@dataclass(frozen=True, slots=True, eq=False)
class GuardMemory:
    """State that the guards carry from tick to tick while something is suspicious; None while nothing is."""

    time: float | FloatArray  # s, robot's clock at the previous tick; scalar, or shape (...)
    held: FloatArray  # shape (..., 3, n), s for which the condition of each guard has held; -1: it does not hold
    side: FloatArray  # shape (..., n), +1 or -1: direction in which the following guard saw the joint pulled
    start: FloatArray  # shape (..., n), rad: position from which it counts how much nearer the joint has come


@dataclass(frozen=True, slots=True, eq=False)
class Guards:
    """The parameters of all guards, and one pure step. An infinite bound, and so an absent one, never trips."""

    joints: tuple[str, ...]
    lower: FloatArray  # shape (n,), rad, the joints' lower limits; -infinity for none
    upper: FloatArray  # shape (n,), rad, upper limits
    following_effort: FloatArray  # (n,), N·m: K_p times the error from which a joint must come nearer; inf: not watched
    following_time: float  # s in which it must have come nearer
    following_progress: float  # rad by which it must
    limit_margin: FloatArray  # shape (n,), rad beyond the limits; infinity: not watched
    limit_time: float  # s
    speed_limit: FloatArray  # shape (n,), rad/s; infinity: not watched
    speed_time: float  # s
    following_within: bool = False
    """True where the following guard takes a command beyond a limit for one to the limit, or to the joint if that is
    further out: policies of legs ask for more than their joints have, and a joint at its stop does not then lag."""
    _lowest: FloatArray = field(init=False, repr=False)
    _highest: FloatArray = field(init=False, repr=False)
    _times: FloatArray = field(init=False, repr=False)  # shape (3, 1)

    def __post_init__(self) -> None:
        put = partial(object.__setattr__, self)
        put("_lowest", self.lower - self.limit_margin)
        put("_highest", self.upper + self.limit_margin)
        put("_times", np.array([[self.following_time], [self.limit_time], [self.speed_time]]) - _ROUNDING)

    def watch(self, memory: GuardMemory | None, state: MITState, command: MITCommand) -> GuardMemory | None:
        """Return the memory after a tick of one robot or a batch, shape (..., n); None where no condition holds.

        The state may hold any values; the command, which is about to leave, is finite.
        """
        with np.errstate(all="ignore"):
            position = state.joint_position
            spring = command.stiffness * (command.position - position)
            above, below = position > self._highest, position < self._lowest
            fast = np.abs(state.joint_velocity) > self.speed_limit
            pulled = np.abs(spring) > self.following_effort
            if not np.count_nonzero(pulled | above | below | fast):  # nearly every tick ends here
                return None
            push, spring = spring + command.effort, self._spring(state, command)
            pulled = np.abs(spring) > self.following_effort
            condition = np.stack([pulled, (above & (push > 0.0)) | (below & (push < 0.0)), fast], axis=-2)
            condition &= (np.isfinite(position) & (state.joint_age < _STALE) & np.isfinite(spring))[..., None, :]
            return self._count(memory, state, condition, np.where(spring < 0.0, -1.0, 1.0))

    def _spring(self, state: MITState, command: MITCommand) -> FloatArray:
        """Return K_p times the error that the following guard judges, shape (..., n), N·m."""
        position, wanted = state.joint_position, command.position
        if self.following_within:
            wanted = np.clip(wanted, np.minimum(self.lower, position), np.maximum(self.upper, position))
        spring: FloatArray = command.stiffness * (wanted - position)
        return spring

    def _count(
        self, memory: GuardMemory | None, state: MITState, condition: BoolArray, side: FloatArray
    ) -> GuardMemory | None:
        """Add this tick to the time for which each condition, shape (..., 3, n), has held."""
        position, time = state.joint_position, state.time
        if not condition.any():
            return None
        if memory is None:
            return GuardMemory(time, np.where(condition, 0.0, -1.0), side, position)
        elapsed = np.clip(np.nan_to_num(np.subtract(time, memory.time)), 0.0, _LONGEST_STEP)[..., None, None]
        held = np.where(memory.held >= 0.0, memory.held + elapsed, 0.0)
        # A joint that has come nearer, or is now pulled the other way, begins again from where it is; one that is
        # pushed back counts from there.
        advance = (position - memory.start) * side
        is_new = (side != memory.side) | (memory.held[..., _FOLLOWING, :] < 0.0)
        follows = is_new | np.asarray(advance >= self.following_progress)
        held[..., _FOLLOWING, :] = np.where(follows, 0.0, held[..., _FOLLOWING, :])
        start = np.where(follows | (advance < 0.0), position, memory.start)
        return GuardMemory(time, np.where(condition, held, -1.0), side, start)

    def problems(self, memory: GuardMemory | None, state: MITState, command: MITCommand) -> dict[int, str]:
        """Return the guard that tripped first, and why, for each robot of a batch by its index, 0 for the only one.

        The memory is that of `watch` with this state and command.
        """
        if memory is None or not (late := memory.held >= self._times).any():
            return {}
        n = len(self.joints)
        late = late.reshape(-1, 3, n)
        arrays = (
            *(state.joint_position, state.joint_velocity, command.position, command.stiffness, command.effort),
            *(memory.held[..., _FOLLOWING, :], self._spring(state, command)),
        )
        values = np.array([array.reshape(-1, n) for array in arrays])
        found: dict[int, str] = {}
        for i in np.flatnonzero(late.any(axis=(1, 2))).tolist():
            guard, j = np.argwhere(late[i])[0].tolist()
            at, speed, wanted, stiffness, effort, held, pull = values[:, i, j].tolist()
            name = self.joints[j]
            if guard == _FOLLOWING:
                found[i] = (
                    f"following guard: {name} does not follow: it is at {at:.2f} rad, commanded to {wanted:.2f}, and "
                    f"came no nearer for {held:.2f} s although K_p times the error is {pull:.1f} N·m; is it held, or "
                    "its direction or zero wrong?"
                )
            elif guard == _LIMIT:
                limit, push = self.upper[j] if at > self.upper[j] else self.lower[j], stiffness * (wanted - at) + effort
                found[i] = (
                    f"limit guard: {name} is at {at:.2f} rad, {abs(at - limit):.2f} beyond its limit of {limit:.2f}, "
                    f"commanded to {wanted:.2f} and pushed outward with {abs(push):.1f} N·m; is its homing offset "
                    "wrong?"
                )
            else:
                found[i] = f"speed guard: {name} turns at {speed:.1f} rad/s, its limit is {self.speed_limit[j]:.1f}"
        return found
