"""Inputs of a tick other than the robot's: intents, live inputs, and a velocity."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from humanoid_sim.controllers.parameters import command_problem
from humanoid_sim.errors import InputError, number_in
from humanoid_sim.messages import Intent, TickOutput
from humanoid_sim.mit import VELOCITY_COMMAND, Extern, FloatArray, MITCommand


class IntentSource(Protocol):
    """An operator, a script, a gamepad. Nothing here waits."""

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """Return the intents since the last call.

        `time` is in s on the robot's clock; `output` of the previous tick, None in the first.
        """

    @property
    def finished(self) -> bool:
        return False


class ExternSource(Protocol):
    """Named live observation terms: piano keys, a velocity command."""

    def latest(self) -> Mapping[str, Extern]:
        """Return the latest value of every term that ever came."""


def remote_problem(joint_names: Sequence[str], command: MITCommand, joints: tuple[str, ...]) -> str:
    """Return why a command of shape (n,) is not accepted by a robot with these joints, in this order; else ''."""
    if tuple(joint_names) != joints:
        given = ", ".join(joint_names)[:400] or "missing"
        return f"remote command: joint_names are {given}, expected {', '.join(joints)} in this order"
    problem = command_problem(command, joints)
    return f"remote {problem}" if problem else ""


@dataclass(slots=True)
class Turn:
    """The right to command something: its owner's until it falls silent, or another takes it over deliberately."""

    owner: str = ""
    until: float = -math.inf  # s, robot's clock

    def expire(self, time: float) -> bool:
        """Release an owner that is silent; `time` in s, robot's clock. True if nobody owns it."""
        if not time <= self.until:
            self.owner = ""
        return not self.owner

    def take(self, producer: str, until: float) -> None:
        """Let that producer own the turn until that time."""
        self.owner, self.until = producer, until


_STEP = 0.1  # m/s, and rad/s, that one key press adds
VELOCITY_KEYS: Mapping[str, tuple[float, float, float]] = {
    **dict.fromkeys(("w", "up"), (_STEP, 0.0, 0.0)),
    **dict.fromkeys(("s", "down"), (-_STEP, 0.0, 0.0)),
    ",": (0.0, _STEP, 0.0),
    ".": (0.0, -_STEP, 0.0),
    **dict.fromkeys(("j", "left"), (0.0, 0.0, _STEP)),
    **dict.fromkeys(("k", "right"), (0.0, 0.0, -_STEP)),
    "0": (0.0, 0.0, 0.0),
}
"""Key to what it adds to vx, vy and the yaw rate; all zeros: stop."""
VELOCITY_HELP = (
    f"velocity, by {_STEP:g}: w s or arrow up down: forward, back; , . left, right; j k or arrow left right: turn; "
    "0 stop"
)
_WIDEST = np.array([[-10.0, 10.0], [-10.0, 10.0], [-4.0 * np.pi, 4.0 * np.pi]])
"""m/s, m/s and rad/s, of a policy that states no ranges: beyond them the unit is wrong."""
KEYBOARD = "keyboard"  # owner of a velocity that was set in this process


def parse_velocity(text: str, ranges: FloatArray | None) -> FloatArray:
    """Read `vx,vy,wz`, m/s, m/s and rad/s; `ranges`, shape (3, 2), are what the policy knows, None: anything."""
    values = [number_in(part) for part in text.split(",")]
    if len(values) != 3 or any(map(math.isnan, values)):
        raise InputError(f"--command: is '{text}', expected vx,vy,wz: three numbers in m/s, m/s and rad/s")
    axes = (("vx", "m/s"), ("vy", "m/s"), ("wz", "rad/s"))
    for (name, unit), value, (low, high) in zip(axes, values, _WIDEST if ranges is None else ranges, strict=True):
        if not low <= value <= high:
            raise InputError(f"--command: {name} is {value:g} {unit}, expected {low:.4g} to {high:.4g} {unit}")
    return np.array(values)


@dataclass(eq=False)
class VelocityCommand:
    """A velocity for policies that walk. What the keyboard set holds; what another producer set, until it is silent."""

    command: FloatArray  # shape (3,), vx and vy in m/s, yaw rate in rad/s, heading frame
    ranges: FloatArray | None = None  # shape (3, 2), for changes; None: what `parse_velocity` accepts

    def __post_init__(self) -> None:
        self.turn = Turn()
        self._set(self.command, 0.0, math.inf)

    def latest(self) -> Mapping[str, Extern]:
        return self._extern

    def press(self, key: str) -> None:
        change = VELOCITY_KEYS[key]
        self.turn.take(KEYBOARD, math.inf)
        self._set(self._clipped(self.command + change if any(change) else np.zeros(3)), 0.0, math.inf)

    def offer(self, producer: str, value: FloatArray, arrival_time: float, *, timeout: float, deliberate: bool) -> bool:
        """Take the command of a producer if it owns the velocity, or takes it over; return True if it does.

        A stick at rest is not deliberate: it claims nothing. `value` has shape (3,), times are in s.
        """
        if not deliberate and self.turn.owner != producer:
            return False
        self.turn.take(producer, arrival_time + timeout)
        self._set(self._clipped(value), arrival_time, timeout)
        return True

    def expire(self, time: float) -> None:
        """Zero the command of a producer that fell silent; `time` in s, robot's clock."""
        if self.turn.owner and self.turn.expire(time):
            self._set(np.zeros(3), 0.0, math.inf)

    def _set(self, value: FloatArray, arrival_time: float, timeout: float) -> None:
        self.command = value
        self._extern = {VELOCITY_COMMAND: Extern(value, arrival_time, timeout)}

    def _clipped(self, value: FloatArray) -> FloatArray:
        low, high = np.transpose(_WIDEST if self.ranges is None else self.ranges)
        clipped: FloatArray = np.clip(value, low, high)
        return np.round(clipped, 6)
