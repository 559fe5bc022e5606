"""One joint by sliders in REMOTE: from what an operator wants to commands that are bounded and change gradually.

The chosen joint follows its sliders; all others hold the positions that they had when they were last left alone, at
STANDBY's gains. Whatever changes, every field of every joint goes from what was commanded before to where it should be
at a limited rate, beginning with the damped hold that REMOTE has without commands: nothing jumps.

Pure functions of arrays in the robot's order of joints; no clock, no socket.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from humanoid_sim.controllers.damping import damped_command
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import COMMAND_FIELDS, FloatArray, MITCommand, frozen_array
from humanoid_sim.robots.guards import speed_limit
from humanoid_sim.robots.motors import MOTORS
from humanoid_sim.robots.schema import JointDescription, RobotDescription

_POSITION_RATE = 1.0
"""rad/s at which the commanded position moves."""
_RAMP = 1.0
"""s in which any other field goes through its whole range, and the gains of a joint that is held come in."""
_FASTEST = 3.0
"""rad/s that a slider commands at most, however fast the joint may turn; and half of its limit."""
_GAIN_SHARE = 2.0
"""Largest gain of a slider, as a multiple of the largest that the description gives a joint."""
_FURTHEST = 0.3
"""Largest distance of the commanded position from the joint, rad: raising K_p never pulls at more than that."""
_SPRING_SHARE = 0.5
"""Largest share of the effort limit for K_p times that distance; the following guard trips at 0.8."""
_SLOWING = 0.25
"""s: a velocity that leads out of the limits is lowered to the rest of the way over this."""
_LONGEST_STEP = 0.05
"""s that one step may cover."""
_HALF_TURN = math.pi
"""rad to each side that a joint without limits may be moved from where it was."""
_POSITION, _VELOCITY, _EFFORT, _STIFFNESS, _DAMPING = range(5)
"""Rows of a command, as in `COMMAND_FIELDS`."""


class Goals(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Positions of the sliders of the chosen joint."""

    position: float
    """rad"""
    velocity: float = 0.0
    """rad/s"""
    effort: float = 0.0
    """N·m"""
    stiffness: float = 0.0
    """N·m/rad"""
    damping: float = 0.0
    """N·m·s/rad"""


@dataclass(frozen=True, slots=True)
class Bounds:
    """Lowest and highest value of each slider of one joint, in the units of `Goals`."""

    position: tuple[float, float]
    velocity: tuple[float, float]
    effort: tuple[float, float]
    stiffness: tuple[float, float]
    damping: tuple[float, float]

    def clipped(self, goals: Goals) -> Goals:
        """Return the goals within the bounds. Raises `FieldError` if one is not a finite number."""
        values = {}
        for name in COMMAND_FIELDS:
            value = getattr(goals, name)
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise FieldError(f"sliders: {name} is {value!r}, expected a finite number")
            low, high = getattr(self, name)
            values[name] = float(min(max(value, low), high))
        return Goals(**values)


@dataclass(frozen=True, slots=True, eq=False)
class SliderState:
    """The joint that is moved, and the latest command."""

    joint: int
    """Index of the chosen joint."""
    bounds: Bounds
    goals: Goals
    """Goals within the bounds."""
    held: FloatArray
    """Shape (n,), positions at which the other joints are held, rad."""
    fields: FloatArray
    """Shape (5, n), rows as in `COMMAND_FIELDS`: latest command, before it was restrained."""
    command: MITCommand

    def __post_init__(self) -> None:
        for name in ("held", "fields"):
            object.__setattr__(self, name, frozen_array("SliderState", name, getattr(self, name)))


class Sliders:
    """The arithmetic for one robot."""

    def __init__(self, robot: RobotDescription, standby: str = "a") -> None:
        """Take the limits of a robot, and the gains of one of its standby controllers, `a` or `b`.

        Raises `FieldError` if STANDBY has no K_p, so that nothing would hold the other joints.
        """
        settings = robot.standby_controller_b if standby == "b" else robot.standby_controller_a
        self._robot = robot
        self._held_gains = np.array([settings.target_stiffness, settings.target_damping])
        if not self._held_gains[0].any():
            raise FieldError(f"sliders: STANDBY of {robot.name} has no K_p, so nothing would hold the other joints")
        self._passive_damping = robot.passive_damping
        # Velocity and effort of a joint that was let go return to 0 as its sliders would.
        bounds = [self.bounds(joint, 0.0) for joint in range(robot.joint_count)]
        self._rates = np.array([[getattr(each, name)[1] / _RAMP for each in bounds] for name in COMMAND_FIELDS])
        self._rates[_POSITION] = _POSITION_RATE
        self._held_rates = self._rates.copy()
        largest = np.maximum(self._held_gains, [np.zeros(robot.joint_count), self._passive_damping])
        self._held_rates[_STIFFNESS:] = np.where(largest > 0.0, largest / _RAMP, self._rates[_STIFFNESS:])

    def bounds(self, joint: int, position: float) -> Bounds:
        """Return what a joint's sliders may ask for.

        One without limits may go half a turn from `position`, rad, where it is.
        """
        described = self._robot.joints[joint]
        lower = described.lower if math.isfinite(described.lower) else position - _HALF_TURN
        upper = described.upper if math.isfinite(described.upper) else position + _HALF_TURN
        fastest = min(_FASTEST, 0.5 * float(speed_limit(self._robot)[joint]))
        effort = described.effort_limit if math.isfinite(described.effort_limit) else 0.0
        stiffness, damping = self._largest_gains(joint, described)
        return Bounds((lower, upper), (-fastest, fastest), (-effort, effort), (0.0, stiffness), (0.0, damping))

    def _largest_gains(self, joint: int, described: JointDescription) -> tuple[float, float]:
        robot = self._robot
        standbys = (robot.standby_controller_a, robot.standby_controller_b)
        stiffness = _GAIN_SHARE * max(described.stiffness, *(each.target_stiffness[joint] for each in standbys))
        damping = _GAIN_SHARE * max(
            described.damping, self._passive_damping[joint], *(each.target_damping[joint] for each in standbys)
        )
        model = None if described.motor is None else MOTORS.get(described.motor.model)
        if model is None:
            return stiffness, float(damping)
        return min(stiffness, model.stiffness), min(float(damping), model.damping)

    def passive(self, position: FloatArray) -> MITCommand:
        """Return what REMOTE does without commands; `position` has shape (n,), rad."""
        return damped_command(position, self._passive_damping)

    def begin(self, joint: int, position: FloatArray) -> SliderState:
        """Take over: the joints are where they are, damped.

        Args:
            joint: index of the one that is chosen; its sliders start where it is, with gains 0.
            position: shape (n,), rad, measured, finite.
        """
        command = self.passive(position)
        fields = np.stack([getattr(command, name) for name in COMMAND_FIELDS])
        bounds = self.bounds(joint, float(position[joint]))
        return SliderState(joint, bounds, _at_rest(bounds, position[joint]), position, fields, command)

    def again(self, state: SliderState, position: FloatArray) -> SliderState:
        """Go on after commands were missing, and the joints were damped: from there, gradually, to the same goals."""
        fresh = self.begin(state.joint, position)
        return replace(state, fields=fresh.fields, command=fresh.command)

    def choose(self, state: SliderState, joint: int, position: FloatArray) -> SliderState:
        """Choose another joint; the one before is held where it is. Arguments as for `begin`."""
        held = state.held.copy()
        held[state.joint] = position[state.joint]
        bounds = self.bounds(joint, float(position[joint]))
        return replace(state, joint=joint, bounds=bounds, goals=_at_rest(bounds, position[joint]), held=held)

    def snap(self, state: SliderState, position: FloatArray) -> SliderState:
        """Return the chosen joint's sliders to where it is, with gains 0; `position` has shape (n,), rad, measured."""
        fields = state.fields.copy()
        fields[_POSITION, state.joint] = position[state.joint]
        return replace(state, goals=_at_rest(state.bounds, position[state.joint]), fields=fields)

    def wish(self, state: SliderState, goals: Goals) -> SliderState:
        """Take new goals, within the bounds. Raises `FieldError` if one is not a finite number."""
        return replace(state, goals=state.bounds.clipped(goals))

    def step(self, state: SliderState, position: FloatArray, velocity: FloatArray, elapsed: float) -> SliderState:
        """Move towards the goals.

        Args:
            position: shape (n,), rad, measured, finite.
            velocity: shape (n,), rad/s, measured; what is not finite counts as 0.
            elapsed: s since the step before.
        """
        j, goals = state.joint, state.goals
        wanted = np.zeros_like(state.fields)
        wanted[_POSITION], wanted[_STIFFNESS:] = state.held, self._held_gains
        wanted[:, j] = [getattr(goals, name) for name in COMMAND_FIELDS]
        rates = self._held_rates.copy()
        rates[:, j] = self._rates[:, j]
        most = rates * min(max(elapsed, 0.0), _LONGEST_STEP)
        fields = state.fields + np.clip(wanted - state.fields, -most, most)
        away, most_effort = _FURTHEST, _SPRING_SHARE * self._robot.joints[j].effort_limit
        if fields[_STIFFNESS, j] * away > most_effort:
            away = most_effort / fields[_STIFFNESS, j]
        fields[_POSITION, j] = np.clip(fields[_POSITION, j], position[j] - away, position[j] + away)
        sent = fields.copy()
        sent[:, j] = _restrained(fields[:, j], state.bounds, float(position[j]), float(np.nan_to_num(velocity[j])))
        return replace(state, fields=fields, command=MITCommand(*sent))


def _at_rest(bounds: Bounds, position: float) -> Goals:
    return bounds.clipped(Goals(float(position)))


def _restrained(fields: FloatArray, bounds: Bounds, position: float, velocity: float) -> Sequence[float]:
    """Return the fields of one joint, shape (5,), that do not drive it into its limits, nor ever faster.

    A velocity that leads out slows down on the way to the limit. An effort along a motion that is faster than the
    sliders' own velocity fades, and is gone at twice that.
    """
    lower, upper = bounds.position
    low, high = min(lower - position, 0.0) / _SLOWING, max(upper - position, 0.0) / _SLOWING
    effort, fastest = float(fields[_EFFORT]), bounds.velocity[1]
    if effort * velocity > 0.0:
        effort *= min(max(2.0 - abs(velocity) / fastest, 0.0), 1.0)
    slowed = min(max(float(fields[_VELOCITY]), low), high)
    return fields[_POSITION], slowed, effort, fields[_STIFFNESS], fields[_DAMPING]
