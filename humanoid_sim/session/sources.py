"""Inputs of a tick other than the robot's: intents, remote commands, velocities and live terms."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Protocol

import numpy as np

from humanoid_sim.client import monotonic_ns
from humanoid_sim.controllers.parameters import command_problem
from humanoid_sim.errors import InputError, number_in
from humanoid_sim.messages import Intent, Mode, TickOutput
from humanoid_sim.mit import VELOCITY_COMMAND, Extern, FloatArray, MITCommand


class IntentSource(Protocol):
    """An operator, a script, a gamepad. Nothing here waits."""

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """Return the intents since the last call.

        `time` is in s on the robot's clock; `output` of the previous tick, None in the first.
        """

    @property
    def finished(self) -> bool:
        """Return True if this source wants the session to end."""
        return False


class ExternSource(Protocol):
    """Named live observation terms: piano keys, a velocity command."""

    def latest(self) -> Mapping[str, Extern]:
        """Return the latest value of every term that ever came."""


class Freshness:
    """Refuses what was requested for the robot as it was some time ago, or before it was last damped.

    For one source of intents, on the loop's thread. Ages are those of CLOCK_MONOTONIC, whatever the robot's clock does.
    DAMP counts always.
    """

    OLDEST = 0.5
    """s"""

    def __init__(self) -> None:
        self._polled = self._entered = 0
        self._mode = Mode.ZERO_TORQUE

    def follow(self, output: TickOutput | None) -> None:
        """Follow the mode of the previous tick: to be called in every poll, before anything is judged."""
        mode, now = Mode.ZERO_TORQUE if output is None else output.control_mode.mode, monotonic_ns()
        if mode is not self._mode and mode in (Mode.DAMPING, Mode.ZERO_TORQUE):
            # The tick that entered it polled before it was published; a fresh start happens between two ticks.
            self._entered = now if output is None else self._polled
        self._mode, self._polled = mode, now

    def problem(self, seen: int) -> str:
        """Return why a request does not count whose sender saw the robot at `seen`, ns; empty if it does."""
        age = 1e-9 * (monotonic_ns() - seen)
        if age < 0.0:
            return "what its sender had seen is in the future; expected ns of CLOCK_MONOTONIC, as of a tick's stamp"
        if age > self.OLDEST:
            return f"too late, meant for the robot of {age:.2f} s ago, at most {self.OLDEST:g} s; look, and ask again"
        if seen < self._entered:
            return f"the robot went to {self._mode.name} meanwhile, which its sender had not seen; look, and ask again"
        return ""


class PolicySelection:
    """Hands the newest request for another of the loaded policies, a name, to the next tick."""

    def __init__(self) -> None:
        self._wanted = ""

    def request(self, name: str) -> None:
        """Request a policy."""
        self._wanted = name

    def take(self) -> str:
        """Return what was requested since the last call; '' for nothing."""
        wanted, self._wanted = self._wanted, ""
        return wanted


def remote_problem(joint_names: Sequence[str], command: MITCommand, joints: tuple[str, ...]) -> str:
    """Return why a command of shape (n,) is not accepted by a robot with these joints, in this order; else ''."""
    if tuple(joint_names) != joints:
        given = ", ".join(joint_names)[:400] or "missing"
        return f"remote command: joint_names are {given}, expected {', '.join(joints)} in this order"
    problem = command_problem(command, joints)
    return f"remote {problem}" if problem else ""


_STEP = 0.1  # m/s, and rad/s, that one key press adds

_CHANGES = {
    (_STEP, 0.0, 0.0): ("w", "up"),
    (-_STEP, 0.0, 0.0): ("s", "down"),
    (0.0, _STEP, 0.0): (",",),
    (0.0, -_STEP, 0.0): (".",),
    (0.0, 0.0, _STEP): ("j", "left"),
    (0.0, 0.0, -_STEP): ("k", "right"),
    (0.0, 0.0, 0.0): ("0",),
}
VELOCITY_KEYS = MappingProxyType({key: change for change, keys in _CHANGES.items() for key in keys})
"""Key to what it adds to vx, vy and the yaw rate; all zeros: stop."""


def velocity_key_help() -> str:
    """Return the line that names the keys."""
    return (
        f"velocity, by {_STEP:g}: w s or arrow up down: forward, back; , . left, right; j k or arrow left right: turn; "
        "0 stop"
    )


_WIDEST = np.array([[-10.0, 10.0], [-10.0, 10.0], [-4.0 * np.pi, 4.0 * np.pi]])
"""m/s, m/s and rad/s, of a policy that states no ranges: beyond them the unit is wrong."""


def parse_velocity(text: str, ranges: FloatArray | None) -> FloatArray:
    """Read `vx,vy,wz`, m/s, m/s and rad/s; `ranges`, shape (3, 2), are what the policy knows, None: anything.

    Raises `InputError` if there are not three finite numbers, or one is outside of its range.
    """
    values = [number_in(part) for part in text.split(",")]
    if len(values) != 3 or any(map(math.isnan, values)):
        raise InputError(f"--command: is '{text}', expected vx,vy,wz: three numbers in m/s, m/s and rad/s")
    axes = (("vx", "m/s"), ("vy", "m/s"), ("wz", "rad/s"))
    for (name, unit), value, (low, high) in zip(axes, values, _WIDEST if ranges is None else ranges, strict=True):
        if not low <= value <= high:
            why = "" if ranges is None else "; that is what the policy knows"
            raise InputError(f"--command: {name} is {value:g} {unit}, expected {low:.4g} to {high:.4g} {unit}{why}")
    return np.array(values)


KEYBOARD = "keyboard"  # owner of a velocity that was set in this process


class VelocityCommand:
    """An `ExternSource` with one owner: the producer that last changed the command deliberately.

    What the keyboard set holds until it is changed; what a producer outside set, as long as it is repeated.
    """

    def __init__(self, command: FloatArray, ranges: FloatArray | None = None, *, is_observed: bool = True) -> None:
        """Start with a command.

        Args:
            command: shape (3,), vx and vy in m/s, yaw rate in rad/s, heading frame.
            ranges: shape (3, 2), to which changes are clipped; None: to what `parse_velocity` accepts.
            is_observed: the policy takes a command; if not, no tick has one.
        """
        self.owner = ""
        """Owner that changed it last: a producer, or `KEYBOARD`; '' if nobody did, or that producer fell silent."""
        self._ranges = np.array(_WIDEST if ranges is None else ranges, dtype=np.float64)
        self._is_observed = is_observed
        self._extern = {VELOCITY_COMMAND: Extern(np.array(command, dtype=np.float64), 0.0)}

    @property
    def command(self) -> FloatArray:
        """Shape (3,)."""
        return self._extern[VELOCITY_COMMAND].value

    def latest(self) -> Mapping[str, Extern]:
        """Return the command. One that was set here never grows too old."""
        return self._extern if self._is_observed else {}

    def press(self, key: str) -> None:
        """Change the command as one of `VELOCITY_KEYS` says."""
        change = VELOCITY_KEYS[key]
        self.owner = KEYBOARD
        self._set(self.command + change if any(change) else np.zeros(3), 0.0, math.inf)

    def offer(self, owner: str, value: FloatArray, arrival_time: float, *, timeout: float, deliberate: bool) -> str:
        """Take the command of a producer if it owns the velocity, or takes it over; return the owner.

        Args:
            value: shape (3,), finite.
            arrival_time: s, robot's clock.
            timeout: s after which the command is zero.
            deliberate: somebody changed it just now. A stick at rest is not: it claims nothing.
        """
        if deliberate:
            self.owner = owner
        if self.owner == owner:
            self._set(value, arrival_time, timeout)
        return self.owner

    def expire(self, time: float) -> None:
        """Zero the command of a producer that fell silent; `time` in s, robot's clock."""
        held = self._extern[VELOCITY_COMMAND]
        if not max(time - held.arrival_time, 0.0) <= held.timeout:
            self.owner = ""
            self._extern = {VELOCITY_COMMAND: Extern(np.zeros(3), 0.0)}

    def _set(self, value: FloatArray, arrival_time: float, timeout: float) -> None:
        bounded = np.clip(value, self._ranges[:, 0], self._ranges[:, 1])
        self._extern = {VELOCITY_COMMAND: Extern(np.round(bounded, 6), arrival_time, timeout)}
