"""The safety properties of a control stack, checked on each tick from inputs and outputs alone.

Everything here is written out again, from the operator's point of view: no rule or table of the FSM is used, so a
mistake there cannot hide itself. What a mode's command must look like is taken from the settings of its controller.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.damping import DampingController
from humanoid_sim.controllers.guards import Guards
from humanoid_sim.controllers.remote_policy import RemotePolicyController
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.controllers.standby import StandbyController
from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.messages import Intent, RemoteCommand, TickInput, TickOutput
from humanoid_sim.mit import COMMAND_FIELDS, FloatArray, MITCommand

ZERO = "zero_torque_controller"
DAMPING = "damping_controller"
STANDBY_A = "standby_controller_a"
STANDBY_B = "standby_controller_b"
RL = "rl_policy_controller"
REMOTE = "remote_policy_controller"

MODE_NUMBER: Mapping[str, int] = {ZERO: 0, DAMPING: 1, STANDBY_A: 2, STANDBY_B: 2, RL: 3, REMOTE: 4}
"""The mode that each controller is, as on the wire."""

SAFE = (ZERO, DAMPING)

EDGES: Mapping[tuple[str, str], Intent] = {
    (ZERO, DAMPING): Intent.DAMP,
    (DAMPING, STANDBY_A): Intent.LOAD_A,
    (DAMPING, STANDBY_B): Intent.LOAD_B,
    (STANDBY_A, RL): Intent.START_LOCOMOTION,
    (STANDBY_A, REMOTE): Intent.START_REMOTE,
    (STANDBY_B, RL): Intent.START_LOCOMOTION,
    (STANDBY_B, REMOTE): Intent.START_REMOTE,
}
"""Between two ticks the controller stays, follows one of these edges with its intent, or leaves for SAFE."""

_ROUNDING = 1e-9
"""s. Times are decimal fractions that binary numbers round."""
_HEARD = 0.1
"""s: a joint that is silent for longer is not judged."""
_LONGEST_STEP = 0.05
"""s of guards' time that one tick is worth at most."""
_LONGEST_LOOK = 200
"""Ticks."""
_PLAIN = (str, int, bool, type(None))


class SafetyViolationError(AssertionError):
    """A control stack or a controller broke a safety property; the message says which, and how."""


def require(holds: bool, message: str, *values: object) -> None:
    """Raise a `SafetyViolationError` unless the property holds; unlike `assert`, under `python -O` too.

    Args:
        message: with a `{}` for each of `values`: arrays are written out only when there is something to say.
        values: what the message shows.
    """
    if not holds:
        raise SafetyViolationError(message.format(*values))


def fingerprint(value: Any) -> Any:
    """Give a value that is equal for two things exactly when every bit of them is: -0.0 is not 0.0, NaN equals itself.

    Looks into dataclasses, arrays, sequences and mappings; everything else is told apart by its type and `repr`.
    """
    kind = type(value)
    if kind in _PLAIN or isinstance(value, Enum):
        return kind.__name__, value
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    names = _field_names(kind)  # type: ignore[arg-type]  # mypy takes the class's own hash for its instances'
    if names is not None:
        return kind.__name__, tuple([fingerprint(getattr(value, name)) for name in names])
    if isinstance(value, tuple | list):
        return tuple([fingerprint(item) for item in value])
    if hasattr(value, "items"):
        return tuple([(key, fingerprint(item)) for key, item in value.items()])
    return kind.__name__, repr(value)


@cache
def _field_names(kind: type) -> tuple[str, ...] | None:
    """Names of a dataclass's fields; None for every other type. Asked for once per type: every tick is looked at."""
    return tuple(f.name for f in fields(kind)) if is_dataclass(kind) else None


class SafetyProperties:
    """Watches one run of a stack from its first tick.

    - The command is finite, complete, read-only and as its mode's controller must give it.
    - DAMP is obeyed in the tick in which it arrives, from every mode.
    - No tick with a safety status other than OK ends in a mode that moves.
    - A mode changes only by the operator's intent along the FSM's edges, or down to DAMPING or ZERO_TORQUE; nothing
      recovers by itself, and DAMPING never goes limp.
    - A controller that fails is named with its fallback, which gives this tick's command; none raises.
    - A joint that is pressed, pushed out of its limits, or raced, for longer than the stack's guards allow ends the
      mode; so a guard's trip ends in DAMPING in its tick.
    - LOCOMOTION and REMOTE begin only after a standby pose was reached.
    - A remote command from before the activation, or one that is stale, is never applied.
    """

    def __init__(self, stack: Supervisor) -> None:
        self._stack = stack
        self._name = ZERO
        self._finished = False
        self._time = math.nan
        self._command: MITCommand | None = None
        self._remote = RemoteWatch(stack.controllers.get(REMOTE))
        self._guards = GuardWatch(getattr(stack, "guards", None))

    def copy(self) -> Self:
        """Another watch over the same run, at the same tick."""
        other = copy.copy(self)
        other._remote = copy.copy(self._remote)
        other._guards = self._guards.copy()
        return other

    def check(self, given: TickInput, output: TickOutput) -> None:
        """Check every property for this tick, which follows the one checked before."""
        name = output.control_mode.controller_name
        check_complete(output.command, len(self._stack.joints))
        self._check_mode(name, given, output)
        self._check_change(name, given, output)
        self._check_quit(given, output)
        self._check_faults(name, output)
        self._check_command(name, given, output.command)
        elapsed = float(given.state.time) - self._time
        self._guards.check(given, output.command, moves=name not in SAFE, elapsed=elapsed)
        self._name, self._finished = name, output.standby is not None and output.standby.is_finished
        self._time, self._command = float(given.state.time), output.command

    def _check_mode(self, name: str, given: TickInput, output: TickOutput) -> None:
        mode = output.control_mode.mode
        require(name in MODE_NUMBER, "controller {} is none of {}", name, ", ".join(MODE_NUMBER))
        require(mode.value == MODE_NUMBER[name], "{} reports mode {}", name, mode.name)
        require((output.standby is not None) == (mode.value == 2), "{} with standby {}", mode.name, output.standby)
        unsafe = [status for status in given.safety if status.level.value > 0]
        require(not unsafe or name in SAFE, "{} is in control although safety reports {}", name, unsafe)
        if Intent.DAMP in given.intents:
            failed = name == ZERO and any(fault.controller == DAMPING for fault in output.faults)
            require(name == DAMPING or failed, "DAMP was requested, and {} is in control", name)

    def _check_change(self, name: str, given: TickInput, output: TickOutput) -> None:
        before, wanted = self._name, given.intents
        if name == before:
            return
        require(before not in SAFE or bool(wanted), "{} went to {} by itself", before, name)
        if name not in SAFE or before == ZERO:
            edge = EDGES.get((before, name))
            require(edge is not None, "{} went to {}, which is not an edge of the FSM", before, name)
            require(edge in wanted, "{} went to {} without {}; intents: {}", before, name, edge, wanted)
        if name in (RL, REMOTE):
            require(self._finished, "{} began before {} had finished", name, before)
        require((before, name) != (DAMPING, ZERO), "DAMPING was active and went limp: {}", output.control_mode)

    def _check_quit(self, given: TickInput, output: TickOutput) -> None:
        if output.quit:
            require(Intent.QUIT in given.intents, "quit without QUIT; intents: {}", given.intents)
            require(Intent.DAMP not in given.intents, "QUIT was obeyed although DAMP came with it")
            require(self._name in SAFE, "QUIT was obeyed from {}", self._name)
        elif Intent.QUIT in given.intents:
            said = any(text.startswith("QUIT refused: ") for text in output.refusals)
            require(said, "QUIT had no effect and no refusal says why: {}", output.refusals)

    def _check_faults(self, name: str, output: TickOutput) -> None:
        failed = [fault.controller for fault in output.faults]
        require(name not in failed, "{} failed and stays in control", name)
        require(ZERO not in failed, "{} failed", ZERO)
        require(len(set(failed)) == len(failed), "a controller failed twice in one tick: {}", failed)
        chain = [fault.fallback for fault in output.faults]
        require(chain == [*failed[1:], name][: len(failed)], "{} failed, fallbacks {}, {} leads", failed, chain, name)
        status = output.control_mode.status_message
        for fault in output.faults:
            require(not fault.is_bug, "{} raised: {}", fault.controller, fault.message)
            require(bool(fault.message), "{} failed without saying why", fault.controller)
            require(fault.message in status, "'{}' is not in the status message '{}'", fault.message, status)

    def _check_command(self, name: str, given: TickInput, command: MITCommand) -> None:
        controller = self._stack.controllers[name]
        before = self._command if name == self._name else None
        if name != REMOTE:
            self._remote.leave()
        if name == ZERO:
            check_zero(command)
        elif name == DAMPING:
            check_damping(controller, command, before)
        elif name in (STANDBY_A, STANDBY_B):
            check_standby(controller, command, before)
        elif name == RL:
            check_policy(controller, self._stack.joints, command)
        else:
            time = float(given.state.time)
            self._remote.follow(given, entered=self._name != REMOTE, elapsed=time - self._time)
            self._remote.check(given, command)


def check_complete(command: MITCommand, n: int) -> None:
    """Every command: n joints, all fields finite float64, gains not negative, arrays that nobody can write to."""
    for name in COMMAND_FIELDS:
        values = getattr(command, name)
        require(values.shape == (n,), "command's {} has shape {}, expected ({},)", name, values.shape, n)
        require(values.dtype == np.float64, "command's {} is of {}, expected float64", name, values.dtype)
        require(not values.flags.writeable, "command's {} can be written to by whoever is given it", name)
        require(bool(np.isfinite(values).all()), "command's {} is {}, expected finite numbers", name, values)
    for name in ("stiffness", "damping"):
        values = getattr(command, name)
        require(bool((values >= 0.0).all()), "command's {} is {}, expected no negative gain", name, values)


def check_zero(command: MITCommand) -> None:
    """ZERO_TORQUE: zeros, whichever controller is in its place."""
    require(
        fingerprint(command) == fingerprint(MITCommand.zeros(command.joint_count)),
        "ZERO_TORQUE commands {}, expected zeros in all five fields",
        command,
    )


def check_damping(controller: object, command: MITCommand, before: MITCommand | None) -> None:
    """DAMPING: no stiffness; the package's own controller also keeps its gains and the position it captured.

    `before` is the previous tick's command, if DAMPING was in control then.
    """
    require(not command.stiffness.any(), "DAMPING commands a stiffness of {}, expected zeros", command.stiffness)
    if type(controller) is not DampingController:
        return
    _no_feed_forward("DAMPING", command)
    _same("DAMPING's damping", command.damping, controller.damping)
    if before is not None:
        _same("DAMPING's position, captured at activation,", command.position, before.position)


def check_standby(controller: object, command: MITCommand, before: MITCommand | None) -> None:
    """STANDBY: gains rise together from 0 to their targets, and never fall on the way.

    `before` is the previous tick's command, if this controller was in control then.
    """
    if type(controller) is not StandbyController:
        return
    _no_feed_forward("STANDBY", command)
    ramp = _ramp(controller, command)
    require(0.0 <= ramp <= 1.0, "STANDBY's gains are {:g} of their targets, expected 0 to 1", ramp)
    for name in ("stiffness", "damping"):
        wanted = ramp * getattr(controller, f"target_{name}")
        require(
            bool((np.abs(getattr(command, name) - wanted) <= 1e-9 * wanted).all()),
            "STANDBY's {} is {}, expected {:g} of its targets like the other gains",
            name,
            getattr(command, name),
            ramp,
        )
    start = 0.0 if before is None else _ramp(controller, before)
    require(ramp >= start, "STANDBY's gains fell from {:g} to {:g} of their targets", start, ramp)
    require(before is not None or ramp == 0.0, "STANDBY began with {:g} of its gains, expected none", ramp)


def check_policy(controller: object, joints: tuple[str, ...], command: MITCommand) -> None:
    """LOCOMOTION: the policy's own gains on every joint, and joints that it does not drive at 0."""
    if type(controller) is not RLPolicyController:
        return
    _no_feed_forward("LOCOMOTION", command)
    contract = controller.contract
    place = [contract.joint_names.index(name) for name in joints]
    _same("LOCOMOTION's stiffness", command.stiffness, contract.joint_stiffness[place])
    _same("LOCOMOTION's damping", command.damping, contract.joint_damping[place])
    for i, name in enumerate(joints):
        if name not in contract.action_joint_names:
            require(command.position[i] == 0.0, "LOCOMOTION moves {}, which its policy does not drive", name)


class RemoteWatch:
    """REMOTE: only commands that arrived since activation, and none that is stale.

    Keeps the age of the newest command in time that has passed since the controller was first shown it.
    """

    def __init__(self, controller: object) -> None:
        self._controller = controller if type(controller) is RemotePolicyController else None
        self._activation_time = math.nan
        self._ignored: RemoteCommand | None = None
        self._newest: RemoteCommand | None = None
        self._age = math.inf

    def follow(self, given: TickInput, *, entered: bool, elapsed: float) -> None:
        """Take note of a tick in REMOTE, `elapsed` s since the previous one; `entered` in that of the transition."""
        if entered:
            self._newest, self._age = None, math.inf
            self._activation_time, self._ignored = float(given.state.time), given.remote
            return
        self._age += max(elapsed, 0.0)
        remote = given.remote
        if remote is None or (self._ignored is not None and remote.arrival_time == self._ignored.arrival_time):
            return
        if not remote.arrival_time > self._activation_time:
            return
        if self._newest is None or remote.arrival_time != self._newest.arrival_time:
            self._age = 0.0
        self._newest = remote

    def leave(self) -> None:
        """Take note of a tick in another mode."""
        self._newest, self._age = None, math.inf

    def check(self, given: TickInput, command: MITCommand) -> None:
        """Check that the command in REMOTE is the newest one while it is fresh, or the passive hold."""
        if self._controller is None:
            return
        position = given.state.joint_position
        zeros = np.zeros(len(position))
        known = np.where(np.abs(position) <= 1e6, position, 0.0)
        if fingerprint(command) == fingerprint(MITCommand(known, zeros, zeros, zeros, self._controller.damping)):
            return
        if self._newest is None:
            require(False, "REMOTE applies {}, but no command has arrived since it was activated", command)
            return
        require(
            fingerprint(command) == fingerprint(self._newest.command),
            "REMOTE applies {}, expected the newest command {} or the passive hold",
            command,
            self._newest.command,
        )
        timeout = 1e-3 * self._controller.stale_command_timeout_ms
        require(
            self._age <= timeout + _ROUNDING or self._controller.stale_command_policy == "hold",
            "REMOTE applies a command that is {:g} s old, expected the passive hold after {:g} s",
            self._age,
            timeout,
        )


class GuardWatch:
    """No joint is pressed, pushed out of its limits, or raced, for longer than a stack's guards allow.

    Looks back over the last ticks of a mode that moves: whatever held in all of them, for a guard's time and a little
    more, must have ended that mode.
    """

    def __init__(self, guards: Guards | None) -> None:
        self._guards = guards
        self._ticks: list[tuple[float, FloatArray, npt.NDArray[np.bool_]]] = []
        """s from the tick before, positions, and what held: of shape (4, n), pulled up, pulled down, out, fast."""

    def copy(self) -> GuardWatch:
        """Another watch over the same run."""
        other = GuardWatch(self._guards)
        other._ticks = list(self._ticks)
        return other

    def check(self, given: TickInput, command: MITCommand, *, moves: bool, elapsed: float) -> None:
        """Check the tick's command, in a mode that moves or not; `elapsed` s since the tick before."""
        guards, position = self._guards, given.state.joint_position
        if guards is None or not moves or position.shape != guards.lower.shape:
            self._ticks = []
            return
        with np.errstate(all="ignore"):
            pull = command.stiffness * (command.position - position)
            push = pull + command.effort
            upper, lower = guards.upper + guards.limit_margin, guards.lower - guards.limit_margin
            out = ((position > upper) & (push > 0.0)) | ((position < lower) & (push < 0.0))
            fast = np.abs(given.state.joint_velocity) > guards.speed_limit
            hard = guards.following_effort
            held = np.stack([pull > hard, pull < -hard, out, fast]) & (np.abs(position) < np.inf)
        held &= (given.state.joint_age < _HEARD) & (np.abs(pull) < np.inf)
        if not held.any():
            self._ticks = []
            return
        step = min(max(elapsed, 0.0), _LONGEST_STEP) if math.isfinite(elapsed) else 0.0
        self._ticks.append((step, position, held))
        del self._ticks[:-_LONGEST_LOOK]
        names = ("following", "following", "limit", "speed")
        times = (guards.following_time, guards.following_time, guards.limit_time, guards.speed_time)
        for row, (name, time) in enumerate(zip(names, times, strict=True)):
            span = self._since(time + 2.0 * _LONGEST_STEP)
            joints = np.logical_and.reduce([tick[2][row] for tick in span]) if span else np.zeros(1, dtype=bool)
            if name == "following" and joints.any():
                positions = np.stack([tick[1] for tick in span])
                joints &= np.ptp(positions, axis=0) < guards.following_progress
            if joints.any():
                who = guards.joints[int(np.argmax(joints))]
                require(False, "{} should have tripped the {} guard {:g} s ago", who, name, _LONGEST_STEP)

    def _since(self, time: float) -> list[tuple[float, FloatArray, npt.NDArray[np.bool_]]]:
        """Return the ticks of the last `time` s; none if there are not so many."""
        total = 0.0
        for i in range(len(self._ticks) - 1, -1, -1):
            if total > time:
                return self._ticks[i:]
            total += self._ticks[i][0]
        return []


def _ramp(controller: StandbyController, command: MITCommand) -> float:
    """Return the share of its target that the largest gain has reached; 1 where all targets are 0."""
    targets = np.concatenate([controller.target_stiffness, controller.target_damping])
    i = int(np.argmax(targets))
    if targets[i] == 0.0:
        return 0.0
    return float(np.concatenate([command.stiffness, command.damping])[i] / targets[i])


def _no_feed_forward(mode: str, command: MITCommand) -> None:
    for name in ("velocity", "effort"):
        require(
            not getattr(command, name).any(), "{} commands {} {}, expected zeros", mode, name, getattr(command, name)
        )


def _same(what: str, value: FloatArray, wanted: FloatArray) -> None:
    require(fingerprint(value) == fingerprint(np.asarray(wanted)), "{} is {}, expected {}", what, value, wanted)
