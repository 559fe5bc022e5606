"""Non-blocking sources of a tick's inputs other than the robot: intents, remote commands, live terms."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Protocol

import numpy as np

from humanoid_sim.client import monotonic_ns
from humanoid_sim.controllers.parameters import command_problem
from humanoid_sim.errors import FieldError, InputError, number_in
from humanoid_sim.messages import Intent, Mode, RemoteCommand, TickOutput
from humanoid_sim.mit import VELOCITY_COMMAND, Extern, FloatArray, MITCommand


class IntentSource(Protocol):
    """An operator, a script, a gamepad."""

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """Return the intents since the last call.

        `time` is in s on the robot's clock; `output` of the previous tick, None in the first.
        """

    @property
    def finished(self) -> bool:
        """Return whether this source wants the session to end; a source that never does need not say so."""
        return False


class RemoteSource(Protocol):
    """The way in for commands from outside the loop."""

    def latest(self) -> RemoteCommand | None:
        """Return the latest accepted command, if there ever was one."""


class ExternSource(Protocol):
    """Named live observation terms: piano keys, a velocity command."""

    def latest(self) -> Mapping[str, Extern]:
        """Return the latest value of every term that was ever heard."""


class Freshness:
    """Decides whether what somebody asks for still counts, who had seen the robot as it was some time ago.

    For one source of intents, on the loop's thread. Ages are those of CLOCK_MONOTONIC, whatever the robot's clock does.
    DAMP counts always.
    """

    OLDEST = 0.5
    """s"""

    def __init__(self) -> None:
        self._polled = self._entered = 0
        self.mode = Mode.ZERO_TORQUE
        """Mode of the previous tick."""

    def follow(self, output: TickOutput | None) -> None:
        """Take the mode of the previous tick into account: to be called in every poll, before anything is judged."""
        mode, now = Mode.ZERO_TORQUE if output is None else output.control_mode.mode, monotonic_ns()
        if mode is not self.mode and mode in (Mode.DAMPING, Mode.ZERO_TORQUE):
            # The tick that entered it polled before it was published; a fresh start happens between two ticks.
            self._entered = now if output is None else self._polled
        self.mode, self._polled = mode, now

    def problem(self, seen: int) -> str:
        """Return why what was asked for does not count; empty if it does.

        `seen`, ns, is when what its sender had seen was so.
        """
        age = 1e-9 * (monotonic_ns() - seen)
        if age < 0.0:
            return "what its sender had seen is in the future; expected ns of CLOCK_MONOTONIC, as of a tick's stamp"
        if age > self.OLDEST:
            late = f"too late, it was meant for the robot of {age:.2f} s ago"
            return f"{late}, at most {self.OLDEST:g} s; look, and ask again"
        if seen < self._entered:
            return f"the robot went to {self.mode.name} meanwhile, which its sender had not seen; look, and ask again"
        return ""


class PolicySelection:
    """Hands the request for another of the loaded policies to the next tick; used on the control thread alone."""

    def __init__(self) -> None:
        self._wanted = ""

    def request(self, name: str) -> None:
        """Request a policy by its name; the newest request of a tick counts."""
        self._wanted = name

    def take(self) -> str:
        """Return what was requested since the last call; '' for nothing."""
        wanted, self._wanted = self._wanted, ""
        return wanted


class IntentQueue(IntentSource):
    """Intents from other threads (a service, a user interface), handed over at the next tick."""

    def __init__(self, tell: Callable[[str], None] = lambda _: None) -> None:
        """Queue nothing; `tell` records why an intent is left out."""
        self._pending: deque[tuple[Intent, int | None]] = deque()
        self._freshness = Freshness()
        self._tell = tell

    def put(self, intent: Intent, seen: int | None = None) -> None:
        """Queue an intent; may be called from any thread.

        `seen`, ns of CLOCK_MONOTONIC, is as of `Freshness`; None for what never grows old.
        """
        self._pending.append((intent, seen))

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """All queued intents that count."""
        self._freshness.follow(output)
        intents = []
        # Only this side removes, and a deque's ends are atomic: no intent is lost between the two threads.
        for intent, seen in [self._pending.popleft() for _ in range(len(self._pending))]:
            problem = "" if seen is None or intent is Intent.DAMP else self._freshness.problem(seen)
            if problem:
                self._tell(f"{intent.name} refused: {problem}")
            else:
                intents.append(intent)
        return intents


class RemoteInbox:
    """Holds the latest accepted command. One thread puts, the control thread takes."""

    def __init__(
        self, joints: tuple[str, ...], clock: Callable[[], float], latest: RemoteCommand | None = None
    ) -> None:
        """Take commands that name the robot's joints in this order; `clock` is the robot's, s."""
        self._joints = joints
        self._clock = clock
        self._latest = latest
        self.accepted = 0
        self.rejected = 0

    def put(self, joint_names: Sequence[str], command: MITCommand, arrival_time: float | None = None) -> None:
        """Accept a command of shape (n,), which arrived at a time in s on the robot's clock; None: now.

        Raises `FieldError` if the joint names or their order differ, or the command is not one finite value per joint
        and field, its gains not negative.
        """
        problem = remote_problem(joint_names, command, self._joints)
        if problem:
            self.rejected += 1
            raise FieldError(problem)
        self._latest = RemoteCommand(command, self._clock() if arrival_time is None else arrival_time)
        self.accepted += 1

    def latest(self) -> RemoteCommand | None:
        """Return the latest accepted command."""
        return self._latest


_LONGEST_NAMES = 400
"""Characters of joint names that are shown."""


def remote_problem(joint_names: Sequence[str], command: MITCommand, joints: tuple[str, ...]) -> str:
    """Return what keeps a command from outside from being accepted; else ''.

    `joint_names` came with the command, whose shape is (n,); `joints` are the robot's, in its order.
    """
    if tuple(joint_names) != joints:
        given = ", ".join(joint_names)[: _LONGEST_NAMES + 1] or "missing"
        given = f"{given[:_LONGEST_NAMES]} …" if len(given) > _LONGEST_NAMES else given
        return f"remote command: joint_names are {given}, expected {', '.join(joints)} in this order"
    problem = command_problem(command, joints)
    return f"remote {problem}" if problem else ""


_STEP = 0.1
"""m/s, and rad/s, that one key press adds."""

VELOCITY_KEYS: Mapping[str, tuple[float, float, float]] = MappingProxyType(
    {
        "w": (_STEP, 0.0, 0.0),
        "s": (-_STEP, 0.0, 0.0),
        ",": (0.0, _STEP, 0.0),
        ".": (0.0, -_STEP, 0.0),
        "j": (0.0, 0.0, _STEP),
        "k": (0.0, 0.0, -_STEP),
        "0": (0.0, 0.0, 0.0),
        "up": (_STEP, 0.0, 0.0),
        "down": (-_STEP, 0.0, 0.0),
        "left": (0.0, 0.0, _STEP),
        "right": (0.0, 0.0, -_STEP),
    }
)
"""Key to what it adds to vx, vy and the yaw rate; all zeros: stop."""


def velocity_key_help() -> str:
    """One line that names the keys."""
    return (
        f"velocity, by {_STEP:g}: w s or arrow up down: forward, back; , . left, right; j k or arrow left right: turn; "
        "0 stop"
    )


def parse_velocity(text: str, ranges: FloatArray | None) -> FloatArray:
    """Read `vx,vy,wz`, m/s, m/s and rad/s; `ranges`, shape (3, 2), are what the policy knows, None: anything.

    Raises `InputError` if there are not three finite numbers, or one is outside of its range.
    """
    values = velocity_numbers(text)
    for i, (name, unit, largest, doubt) in enumerate(_VELOCITY_AXES):
        low, high = (-largest, largest) if ranges is None else ranges[i]
        if not low <= values[i] <= high:
            why = doubt if ranges is None else "that is what the policy knows"
            accepted = f"{low:.4g} to {high:.4g} {unit}; {why}"
            raise InputError(f"--command: {name} is {values[i]:g} {unit}, expected {accepted}")
    return np.array(values)


def velocity_numbers(text: str) -> list[float]:
    """Return the three numbers of `vx,vy,wz`, whatever a policy knows.

    Raises `InputError` if there are not three finite numbers.
    """
    values = [number_in(part) for part in text.split(",")]
    if len(values) != 3 or any(map(math.isnan, values)):
        raise InputError(f"--command: is '{text}', expected vx,vy,wz: three numbers in m/s, m/s and rad/s")
    return values


_VELOCITY_AXES = (
    ("vx", "m/s", 10.0, "is it in cm/s or km/h?"),
    ("vy", "m/s", 10.0, "is it in cm/s or km/h?"),
    ("wz", "rad/s", 4.0 * math.pi, "is it in degrees per second?"),
)
"""Axes of a command: name, unit, largest magnitude where the policy states no range, and the likely wrong unit."""


KEYBOARD = "keyboard"
"""Owner of a velocity that was set in this process."""


class VelocityCommand:
    """An `ExternSource` with one owner: whoever last changed the command deliberately.

    What the keyboard set holds until it is changed; what a producer outside set, as long as it is repeated. Another
    thread may press keys.
    """

    def __init__(self, command: FloatArray, ranges: FloatArray | None = None) -> None:
        """Start with a command.

        Args:
            command: shape (3,), vx and vy in m/s, yaw rate in rad/s, heading frame.
            ranges: shape (3, 2), to which changes are clipped; None: to what `parse_velocity` accepts.
        """
        self.owner: object = ""
        """Owner that changed it last: a producer, or `KEYBOARD`; falsy if nobody did, or that producer fell silent."""
        self.is_observed = True
        """True if the policy takes a command; if not, no tick has one."""
        self.begin(command, ranges)

    @property
    def command(self) -> FloatArray:
        """Shape (3,)."""
        return self._extern[VELOCITY_COMMAND].value

    def latest(self) -> Mapping[str, Extern]:
        """Return the command. One that was set here never grows too old."""
        return self._extern if self.is_observed else {}

    def begin(self, command: FloatArray, ranges: FloatArray | None = None, *, is_observed: bool = True) -> None:
        """Begin anew for another policy; arguments as for the constructor, and `is_observed` as above."""
        widest = [(-largest, largest) for _, _, largest, _ in _VELOCITY_AXES]
        self._ranges = np.array(widest if ranges is None else ranges, dtype=np.float64)
        self._begun = np.array(command, dtype=np.float64)
        self.is_observed = is_observed
        self.restart()

    def restart(self) -> None:
        """Go back to the command that it began with."""
        self._extern = {VELOCITY_COMMAND: Extern(self._begun, 0.0)}
        self.owner = ""

    def press(self, key: str) -> None:
        """Change the command as a key says; other keys do nothing."""
        change = VELOCITY_KEYS.get(key)
        if change is None:
            return
        value = self.command + change if any(change) else np.zeros(3)
        self.owner = KEYBOARD
        self._set(value, 0.0, math.inf)

    def offer(
        self, owner: object, value: FloatArray, arrival_time: float, *, timeout: float, deliberate: bool
    ) -> object:
        """Take the command of a producer, if the velocity is its own, or becomes so now; who owns it.

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
