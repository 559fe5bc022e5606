"""Guards: what watches the joints while a controller drives them. A trip is a fault of that controller.

| guard | trips where, for its time and without a pause |
|---|---|
| following | K_p times the position error is near the effort limit, and the joint comes no nearer |
| limit | a joint is beyond its limits by more than a margin, and still pushed outward |
| speed | a joint is faster than its limit |

They see what a motor sees: the state of this tick, and the command that is about to leave. In DAMPING and ZERO_TORQUE
nothing is watched, because nothing pushes there: K_p and effort are 0, and what K_d gives takes energy away whichever
way a joint is wired and wherever its zero is.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from humanoid_sim.controllers.parameters import joint_tuple, number, per_joint_or_infinite, range_middle
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import BoolArray, FloatArray, IndexArray, MITCommand, MITState, frozen_array

_LONGEST_STEP = 0.05
"""s that one tick may add: a clock that jumps is no time in which a joint was pressed."""
_STALE = 0.1
"""s after which a joint that is silent is not judged any more: what it does now, nobody knows."""
_FURTHEST = 1e9
"""rad from a joint's middle: no product of a command with less overflows."""
_ROUNDING = 1e-9
"""s. Times are decimal fractions that binary numbers round."""


_FOLLOWING, _LIMIT, _SPEED = range(3)
"""The guards, in reporting order."""


@dataclass(frozen=True, slots=True, eq=False)
class GuardMemory:
    """State that the guards carry from tick to tick while something is suspicious; None while nothing is."""

    time: float | FloatArray
    """s, robot's clock at the previous tick; scalar, or shape (...)."""
    held: FloatArray
    """Shape (..., 3, n), s for which the condition of each guard has held; -1: it does not hold."""
    side: FloatArray
    """Shape (..., n), +1 or -1: direction in which the following guard saw the joint pulled."""
    start: FloatArray
    """Shape (..., n), rad: position from which it counts how much nearer the joint has come."""

    def __post_init__(self) -> None:
        for name in ("held", "side", "start"):
            object.__setattr__(self, name, frozen_array("GuardMemory", name, getattr(self, name)))


@dataclass(frozen=True, slots=True, eq=False)
class Guards:
    """The parameters of all guards, and one pure step. An infinite bound, and so an absent one, never trips."""

    joints: tuple[str, ...]
    lower: FloatArray
    """Shape (n,), rad, the joints' lower limits; -infinity for none."""
    upper: FloatArray
    """Shape (n,), rad, upper limits."""
    effort_limit: FloatArray
    """Shape (n,), N·m, for messages."""
    following_effort: FloatArray
    """Shape (n,), N·m: K_p times the error from which a joint must come nearer; infinity: not watched."""
    following_time: float
    """s in which it must have come nearer."""
    following_progress: float
    """rad by which it must."""
    limit_margin: FloatArray
    """Shape (n,), rad beyond the limits; infinity: not watched."""
    limit_time: float
    """s"""
    speed_limit: FloatArray
    """Shape (n,), rad/s; infinity: not watched."""
    speed_time: float
    """s"""
    speed_assumed: tuple[str, ...] = ()
    """Joints whose speed limit nobody gave and no motor has: it follows from their range."""
    following_within: bool = False
    """True where the following guard takes a command beyond a limit for one to the limit, or to the joint if that is
    further out: policies of legs ask for more than their joints have, and a joint at its stop does not then lag."""
    _middle: FloatArray = field(init=False, repr=False)
    _reach: FloatArray = field(init=False, repr=False)
    _times: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        owner, put = "Guards", object.__setattr__
        put(self, "joints", joint_tuple(owner, self.joints))
        for name in ("lower", "upper", "effort_limit", "following_effort", "limit_margin", "speed_limit"):
            array = per_joint_or_infinite(owner, name, getattr(self, name), self.joints)
            if name not in ("lower", "upper") and (array <= 0.0).any():
                raise FieldError(f"{owner}.{name}: is {array}, expected numbers > 0")
            put(self, name, array)
        put(self, "following_progress", number(owner, "following_progress", self.following_progress, above=True))
        for name in ("following_time", "limit_time", "speed_time"):
            put(self, name, number(owner, name, getattr(self, name)))
        bounded = np.isfinite(self.lower) & np.isfinite(self.upper)
        unbounded = np.isinf(self.lower) & np.isinf(self.upper)
        with np.errstate(invalid="ignore"):
            half = np.where(bounded, 0.5 * (self.upper - self.lower) + self.limit_margin, 0.0)
        # Where only one side is bounded, any position is looked at.
        reach = np.minimum(np.where(unbounded, np.inf, half), _FURTHEST)
        put(self, "_middle", frozen_array(owner, "_middle", range_middle(self.lower, self.upper)))
        put(self, "_reach", frozen_array(owner, "_reach", reach))
        times = np.array([[self.following_time], [self.limit_time], [self.speed_time]])
        put(self, "_times", frozen_array(owner, "_times", times - _ROUNDING))

    def watch(self, memory: GuardMemory | None, state: MITState, command: MITCommand) -> GuardMemory | None:
        """One tick, of one robot or a batch.

        Args:
            state: of this one, shape (..., n).
            command: that is about to leave, shape (..., n); finite.

        Returns:
            What to remember; None where no condition holds.
        """
        position = state.joint_position
        # Nearly every tick ends here: nothing is near a bound. What is not finite, or so far off that a product could
        # overflow, is looked at below.
        off = np.subtract(position, self._middle)
        np.abs(off, out=off)
        fast = np.abs(state.joint_velocity)
        if not (np.count_nonzero(off >= self._reach) or np.count_nonzero(fast >= self.speed_limit)):
            pull = np.subtract(command.position, position)
            np.multiply(command.stiffness, pull, out=pull)
            np.abs(pull, out=pull)
            if not np.count_nonzero(pull >= self.following_effort):
                return None
        with np.errstate(all="ignore"):
            return self._judge(memory, state, command)

    def _judge(self, memory: GuardMemory | None, state: MITState, command: MITCommand) -> GuardMemory | None:
        position = state.joint_position
        spring = self._spring(position, command.position, command.stiffness)
        push = command.stiffness * (command.position - position) + command.effort
        above, below = position > self.upper + self.limit_margin, position < self.lower - self.limit_margin
        condition = np.stack(
            [
                np.abs(spring) > self.following_effort,
                (above & (push > 0.0)) | (below & (push < 0.0)),
                np.abs(state.joint_velocity) > self.speed_limit,
            ],
            axis=-2,
        )
        condition &= (np.isfinite(position) & (state.joint_age < _STALE) & np.isfinite(spring))[..., None, :]
        if not condition.any():
            return None
        side = np.where(spring < 0.0, -1.0, 1.0)
        time = state.time
        if memory is None or memory.held.shape != condition.shape:
            return GuardMemory(time, np.where(condition, 0.0, -1.0), side, position)
        elapsed = np.subtract(time, memory.time)
        elapsed = np.where(elapsed > 0.0, np.minimum(elapsed, _LONGEST_STEP), 0.0)[..., None, None]
        held = np.where(memory.held >= 0.0, memory.held + elapsed, 0.0)
        # A joint that has come nearer, or is now pulled the other way, begins again from where it is; one that is
        # pushed back counts from there.
        advance = (position - memory.start) * side
        fresh = (side != memory.side) | (memory.held[..., _FOLLOWING, :] < 0.0)
        follows = fresh | np.asarray(advance >= self.following_progress)
        held[..., _FOLLOWING, :] = np.where(follows, 0.0, held[..., _FOLLOWING, :])
        start = np.where(follows | (advance < 0.0), position, memory.start)
        return GuardMemory(time, np.where(condition, held, -1.0), side, start)

    def _spring(self, position: FloatArray, wanted: FloatArray, stiffness: FloatArray) -> FloatArray:
        """Return K_p times the error that the following guard judges, shape (..., n), N·m."""
        if self.following_within:
            wanted = np.clip(wanted, np.minimum(self.lower, position), np.maximum(self.upper, position))
        spring: FloatArray = stiffness * (wanted - position)
        return spring

    def tripped(self, memory: GuardMemory | None) -> BoolArray:
        """Return which robots a guard has tripped for, shape (...)."""
        if memory is None:
            return np.zeros((), dtype=bool)
        late = (memory.held >= 0.0) & (memory.held >= self._times)
        return np.asarray(late.any(axis=(-2, -1)))

    def restarted(self, memory: GuardMemory | None, chosen: IndexArray) -> GuardMemory | None:
        """Return the memory of a batch of which some robots, indices (k,), begin afresh."""
        if memory is None:
            return None
        held = memory.held.copy()
        held[chosen] = -1.0
        return replace(memory, held=held)

    def problems(self, memory: GuardMemory | None, state: MITState, command: MITCommand) -> dict[int, str]:
        """By the index of each robot for which a guard has tripped (0 for the only one), its `problem`."""
        tripped = self.tripped(memory)
        if not tripped.ndim:
            return {0: self.problem(memory, state, command)} if tripped else {}
        return {i: self.problem(memory, state, command, i) for i in np.flatnonzero(tripped).tolist()}

    def problem(self, memory: GuardMemory | None, state: MITState, command: MITCommand, i: int | tuple[()] = ()) -> str:
        """Return what the first guard that has tripped saw, and what may be the cause; '' if none has.

        Args:
            memory: of `watch` with this state and command.
            i: which robot of a batch; () for the only one.
        """
        if memory is None:
            return ""
        held = memory.held[i]
        late = np.argwhere((held >= 0.0) & (held >= self._times))
        if not len(late):
            return ""
        guard, joint = (int(index) for index in late[0])
        at = float(state.joint_position[i][joint])
        name, lower, upper = self.joints[joint], float(self.lower[joint]), float(self.upper[joint])
        wanted = float(command.position[i][joint])
        spring = float(command.stiffness[i][joint]) * (wanted - at)
        if guard == _SPEED:
            speed = float(state.joint_velocity[i][joint])
            origin = " (default, not your motor's)" if name in self.speed_assumed else ""
            return (
                f"speed guard: {name} turns at {speed:.1f} rad/s, its limit is {self.speed_limit[joint]:.1f}{origin}; "
                "a command that jumps, gains that are not stable, or a load that came off?"
            )
        if guard == _LIMIT:
            beyond, limit = (at - upper, upper) if at > upper else (lower - at, lower)
            is_asked = wanted > upper or wanted < lower
            cause = "the command is beyond it" if is_asked else "the commanded effort pushes there"
            return (
                f"limit guard: {name} is at {at:.2f} rad, {beyond:.2f} beyond its limit of {limit:.2f}, and pushed "
                f"outward with {abs(spring + float(command.effort[i][joint])):.1f} N·m; {cause}, or is the homing "
                f"offset of {name} wrong?"
            )
        pull = float(self._spring(state.joint_position[i], command.position[i], command.stiffness[i])[joint])
        return (
            f"following guard: {name} does not follow: it is at {at:.2f} rad, asked to {wanted:.2f}, and came no "
            f"nearer for {held[_FOLLOWING, joint]:.2f} s although K_p times the error is {pull:.1f} N·m, its limit "
            f"{self.effort_limit[joint]:g}; {self._why_stuck(name, at, wanted, lower, upper)}"
        )

    def _why_stuck(self, name: str, at: float, wanted: float, lower: float, upper: float) -> str:
        """Tell a stop, which keeps a joint from going out, from a joint that cannot come in: it moves the wrong way."""
        near = 0.1 * (upper - lower) if np.isfinite(upper - lower) else 0.0
        inward_from_upper = upper - at <= near and wanted < at
        inward_from_lower = at - lower <= near and wanted > at
        if inward_from_upper or inward_from_lower:
            return f"direction of {name}, or something that holds it?"
        if wanted > upper or wanted < lower:
            return f"the command is beyond the limits of {name}"
        return f"something in the way of {name}, or its direction, homing offset or zero?"
