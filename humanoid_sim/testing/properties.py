"""The safety properties of a control stack, checked on each tick from inputs and outputs alone.

Written from the operator's point of view: no rule or table of the FSM is used, so a mistake there cannot hide itself.
What a mode's command must look like is taken from the settings of its controller, and from its guards.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from typing import Any

import numpy as np

from humanoid_sim.controllers.base import DAMPING, REMOTE_POLICY, RL_POLICY, STANDBY_A, STANDBY_B, ZERO_TORQUE
from humanoid_sim.controllers.damping import DampingController
from humanoid_sim.controllers.guards import GuardMemory
from humanoid_sim.controllers.remote_policy import RemotePolicyController
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.controllers.standby import StandbyController
from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.messages import Intent, RemoteCommand, TickInput, TickOutput
from humanoid_sim.mit import COMMAND_FIELDS, MITCommand

MODE_NUMBER: Mapping[str, int] = {
    ZERO_TORQUE: 0,
    DAMPING: 1,
    STANDBY_A: 2,
    STANDBY_B: 2,
    RL_POLICY: 3,
    REMOTE_POLICY: 4,
}
"""The mode that each controller is, as on the wire."""
SAFE = (ZERO_TORQUE, DAMPING)

EDGES: Mapping[tuple[str, str], Intent] = {
    (ZERO_TORQUE, DAMPING): Intent.DAMP,
    (DAMPING, STANDBY_A): Intent.LOAD_A,
    (DAMPING, STANDBY_B): Intent.LOAD_B,
    (STANDBY_A, RL_POLICY): Intent.START_LOCOMOTION,
    (STANDBY_A, REMOTE_POLICY): Intent.START_REMOTE,
    (STANDBY_B, RL_POLICY): Intent.START_LOCOMOTION,
    (STANDBY_B, REMOTE_POLICY): Intent.START_REMOTE,
}
"""Between two ticks the controller stays, follows one of these edges with its intent, or leaves for SAFE."""

_ROUNDING = 1e-9  # s
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

    - The command is finite, complete and as its mode's controller must give it.
    - DAMP is obeyed in the tick in which it arrives, from every mode.
    - No tick with a safety status other than OK ends in a mode that moves.
    - A mode changes only by the operator's intent along the FSM's edges, or down to DAMPING or ZERO_TORQUE; nothing
      recovers by itself, and DAMPING never goes limp.
    - A controller that fails is named with its fallback, which gives this tick's command; none raises.
    - A guard that trips ends the mode in its tick.
    - A policy is selected in ZERO_TORQUE and DAMPING only, and is the one that runs then.
    - LOCOMOTION and REMOTE begin only after a standby pose was reached.
    - A remote command from before the activation, or one that is stale, is never applied.
    """

    def __init__(self, stack: Supervisor) -> None:
        self._stack = stack
        self._name = ZERO_TORQUE
        self._finished = False
        self._policy = next(iter(stack.policies), "")
        self._time = math.nan
        self._command: MITCommand | None = None
        self._guards: GuardMemory | None = None
        self._entered: tuple[float, RemoteCommand | None] = math.nan, None
        """s at which REMOTE began, and the command that was there already."""
        self._newest: RemoteCommand | None = None
        self._age = math.inf
        """s since the newest remote command was shown to the stack."""

    def check(self, given: TickInput, output: TickOutput) -> None:
        """Check every property for this tick, which follows the one checked before."""
        name = output.control_mode.controller_name
        check_complete(output.command, len(self._stack.joints))
        self._check_mode(name, given, output)
        self._check_change(name, given, output)
        self._check_quit(given, output)
        self._check_selection(given, output)
        self._check_faults(name, output)
        self._check_command(name, given, output.command)
        self._check_guards(name, given, output.command)
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
            failed = name == ZERO_TORQUE and any(fault.controller == DAMPING for fault in output.faults)
            require(name == DAMPING or failed, "DAMP was requested, and {} is in control", name)

    def _check_change(self, name: str, given: TickInput, output: TickOutput) -> None:
        before, wanted = self._name, given.intents
        if name == before:
            return
        require(before not in SAFE or bool(wanted), "{} went to {} by itself", before, name)
        if name not in SAFE or before == ZERO_TORQUE:
            edge = EDGES.get((before, name))
            require(edge is not None, "{} went to {}, which is not an edge of the FSM", before, name)
            require(edge in wanted, "{} went to {} without {}; intents: {}", before, name, edge, wanted)
        if name in (RL_POLICY, REMOTE_POLICY):
            require(self._finished, "{} began before {} had finished", name, before)
        require((before, name) != (DAMPING, ZERO_TORQUE), "DAMPING was active and went limp: {}", output.control_mode)

    def _check_quit(self, given: TickInput, output: TickOutput) -> None:
        if output.quit:
            require(Intent.QUIT in given.intents, "quit without QUIT; intents: {}", given.intents)
            require(Intent.DAMP not in given.intents, "QUIT was obeyed although DAMP came with it")
            require(self._name in SAFE, "QUIT was obeyed from {}", self._name)
        elif Intent.QUIT in given.intents:
            said = any(text.startswith("QUIT refused: ") for text in output.refusals)
            require(said, "QUIT had no effect and no refusal says why: {}", output.refusals)

    def _check_selection(self, given: TickInput, output: TickOutput) -> None:
        if given.policy in self._stack.policies and self._name in SAFE:
            self._policy = given.policy
        elif given.policy:
            said = any(text.startswith(f"policy {given.policy} refused: ") for text in output.refusals)
            require(said, "policy {} was selected in {}, and no refusal says why not", given.policy, self._name)

    def _check_faults(self, name: str, output: TickOutput) -> None:
        failed = [fault.controller for fault in output.faults]
        require(name not in failed, "{} failed and stays in control", name)
        require(ZERO_TORQUE not in failed, "{} failed", ZERO_TORQUE)
        require(len(set(failed)) == len(failed), "a controller failed twice in one tick: {}", failed)
        chain = [fault.fallback for fault in output.faults]
        require(chain == [*failed[1:], name][: len(failed)], "{} failed, fallbacks {}, {} leads", failed, chain, name)
        status = output.control_mode.status_message
        for fault in output.faults:
            require(not fault.is_bug, "{} raised: {}", fault.controller, fault.message)
            require(bool(fault.message), "{} failed without saying why", fault.controller)
            require(fault.message in status, "'{}' is not in the status message '{}'", fault.message, status)

    def _check_command(self, name: str, given: TickInput, command: MITCommand) -> None:
        """Check what the mode's own controller must command; `before` is its command of the tick before."""
        controller = self._stack.controllers[name]
        if name == RL_POLICY and self._policy:
            controller = self._stack.policies[self._policy]
        before = self._command if name == self._name else None
        if name == ZERO_TORQUE:
            _same("ZERO_TORQUE's command", command, MITCommand.zeros(command.joint_count))
        if name == DAMPING:
            _same("DAMPING's stiffness", command.stiffness, np.zeros(command.joint_count))
        if name == REMOTE_POLICY:
            self._note_remote(given)
        if type(controller) in (DampingController, StandbyController, RLPolicyController):  # children may differ
            _same(f"the velocity in {name}", command.velocity, np.zeros(command.joint_count))
            _same(f"the effort in {name}", command.effort, np.zeros(command.joint_count))
        if type(controller) is DampingController:
            _same("DAMPING's damping", command.damping, controller.damping)
            if before is not None:
                _same("DAMPING's position, captured at activation,", command.position, before.position)
        elif type(controller) is StandbyController:
            _check_ramp(controller, command, before)
        elif type(controller) is RLPolicyController:
            contract = controller.contract
            place = [contract.joint_names.index(joint) for joint in self._stack.joints]
            _same("LOCOMOTION's stiffness", command.stiffness, contract.joint_stiffness[place])
            _same("LOCOMOTION's damping", command.damping, contract.joint_damping[place])
            idle = [joint not in contract.action_joint_names for joint in self._stack.joints]
            require(
                not command.position[idle].any(), "LOCOMOTION moves joints that its policy does not drive: {}", idle
            )
        elif type(controller) is RemotePolicyController:
            self._check_remote(controller, given, command)

    def _note_remote(self, given: TickInput) -> None:
        """Keep the newest remote command since REMOTE began, and its age."""
        time, remote = float(given.state.time), given.remote
        if self._name != REMOTE_POLICY:
            self._entered, self._newest, self._age = (time, remote), None, math.inf
            return
        self._age += max(time - self._time, 0.0)
        began, known = self._entered
        is_new = remote is not None and (known is None or remote.arrival_time != known.arrival_time)
        if remote is not None and is_new and remote.arrival_time > began:
            if self._newest is None or remote.arrival_time != self._newest.arrival_time:
                self._age = 0.0
            self._newest = remote

    def _check_remote(self, controller: RemotePolicyController, given: TickInput, command: MITCommand) -> None:
        """REMOTE: the newest command while it is fresh, or the passive hold."""
        position = given.state.joint_position
        zeros, known = np.zeros(len(position)), np.where(np.abs(position) <= 1e6, position, 0.0)
        if fingerprint(command) == fingerprint(MITCommand(known, zeros, zeros, zeros, controller.damping)):
            return
        newest, timeout = self._newest, 1e-3 * controller.stale_command_timeout_ms
        require(newest is not None, "REMOTE applies {}, but no command has arrived since it was activated", command)
        if newest is not None:
            _same("REMOTE's command, unless it is the passive hold,", command, newest.command)
        is_fresh = self._age <= timeout + _ROUNDING or controller.stale_command_policy == "hold"
        require(is_fresh, "REMOTE applies a command that is {:g} s old, expected the passive hold", self._age)

    def _check_guards(self, name: str, given: TickInput, command: MITCommand) -> None:
        guards = self._stack.guards
        if guards is None or name in SAFE or given.state.joint_position.shape != guards.lower.shape:
            self._guards = None
            return
        self._guards = guards.watch(self._guards, given.state, command)
        problem = guards.problem(self._guards, given.state, command)
        require(not problem, "{} goes on although a guard has tripped: {}", name, problem)


def check_complete(command: MITCommand, n: int) -> None:
    """Every command: n joints, all fields finite, gains not negative."""
    for name in COMMAND_FIELDS:
        values = getattr(command, name)
        require(values.shape == (n,), "command's {} has shape {}, expected ({},)", name, values.shape, n)
        require(bool(np.isfinite(values).all()), "command's {} is {}, expected finite numbers", name, values)
    for name in ("stiffness", "damping"):
        values = getattr(command, name)
        require(bool((values >= 0.0).all()), "command's {} is {}, expected no negative gain", name, values)


def _check_ramp(controller: StandbyController, command: MITCommand, before: MITCommand | None) -> None:
    """STANDBY: gains rise together from 0 to their targets, and never fall on the way."""
    targets = np.concatenate([controller.target_stiffness, controller.target_damping])
    gains = np.concatenate([command.stiffness, command.damping])
    largest = int(np.argmax(targets))
    ramp = float(gains[largest] / targets[largest]) if targets[largest] else 0.0
    together = bool((np.abs(gains - ramp * targets) <= 1e-9 * targets).all())
    require(together and 0.0 <= ramp <= 1.0, "STANDBY's gains are {}, expected one share of {}", gains, targets)
    least = np.zeros(len(gains)) if before is None else np.concatenate([before.stiffness, before.damping])
    require(bool((gains >= least).all()), "STANDBY's gains fell from {} to {}", least, gains)
    require(before is not None or ramp == 0.0, "STANDBY began with {:g} of its gains, expected none", ramp)


def _same(what: str, value: object, wanted: object) -> None:
    require(fingerprint(value) == fingerprint(wanted), "{} is {}, expected {}", what, value, wanted)
