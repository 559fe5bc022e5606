"""The safety properties of a control stack, checked on each tick without a rule or table of the FSM itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np

from humanoid_sim.controllers.base import DAMPING, REMOTE_POLICY, RL_POLICY, STANDBY_A, STANDBY_B, ZERO_TORQUE
from humanoid_sim.controllers.damping import DampingController
from humanoid_sim.controllers.guards import GuardMemory
from humanoid_sim.controllers.remote_policy import RemotePolicyController
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.controllers.standby import StandbyController
from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.messages import Intent, RemoteCommand, TickInput, TickOutput
from humanoid_sim.mit import COMMAND_FIELDS, MITCommand, MITState

MODE_NUMBER = {ZERO_TORQUE: 0, DAMPING: 1, STANDBY_A: 2, STANDBY_B: 2, RL_POLICY: 3, REMOTE_POLICY: 4}  # on the wire
SAFE = (ZERO_TORQUE, DAMPING)
EDGES: Mapping[Intent, tuple[tuple[str, ...], str]] = {  # controllers that an intent leads from, and to
    Intent.DAMP: ((ZERO_TORQUE,), DAMPING),
    Intent.LOAD_A: ((DAMPING,), STANDBY_A),
    Intent.LOAD_B: ((DAMPING,), STANDBY_B),
    Intent.START_LOCOMOTION: ((STANDBY_A, STANDBY_B), RL_POLICY),
    Intent.START_REMOTE: ((STANDBY_A, STANDBY_B), REMOTE_POLICY),
}
_ROUNDING = 1e-9  # s
_Result = TypeVar("_Result")
_LARGEST_KNOWN = 1e6  # rad: positions beyond it count as unknown


class SafetyViolationError(AssertionError):
    """A control stack or a controller broke a safety property."""


def require(holds: bool, message: str, *values: object) -> None:
    """Raise a `SafetyViolationError` unless the property holds: `message` with `values` in its `{}`."""
    if not holds:
        raise SafetyViolationError(message.format(*values))


def fingerprint(value: Any) -> Any:
    """Return a value that is equal for two things exactly when each of their bits is: -0.0 is not 0.0, NaN is NaN."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if is_dataclass(value):
        return type(value).__name__, *[fingerprint(getattr(value, field.name)) for field in fields(value)]
    if isinstance(value, tuple | list):
        return tuple([fingerprint(item) for item in value])
    if isinstance(value, Mapping):
        return tuple([(key, fingerprint(item)) for key, item in value.items()])
    return type(value).__name__, repr(value)


def run_twice(function: Callable[..., _Result], *given: Any) -> _Result:
    """Return what a function returns: it raises nothing, gives the same bits again, and changes nothing given."""
    before = fingerprint(given)
    try:
        result, again = function(*given), function(*given)
    except Exception as error:
        raise SafetyViolationError(f"raised {type(error).__name__}: {error}") from error
    require(before == fingerprint(given), "what it was given changed")
    require(fingerprint(result) == fingerprint(again), "the same inputs gave {} and {}", result, again)
    return result


def check_complete(command: MITCommand, n: int) -> None:
    """Check that a command has n joints, finite values and no negative gain."""
    require(command.position.shape == (n,), "command has shape {}, expected ({},)", command.position.shape, n)
    for name in COMMAND_FIELDS:
        values = getattr(command, name)
        require(np.isfinite(values).all(), "command's {} is {}, expected finite numbers", name, values)
    for gains in (command.stiffness, command.damping):
        require(bool((gains >= 0.0).all()), "command has gains {}, expected no negative gain", gains)


class SafetyProperties:
    """Watches one run of a stack from its first tick; `docs/testing.md` lists what must hold."""

    def __init__(self, stack: Supervisor) -> None:
        self._stack = stack
        self._name = ZERO_TORQUE
        self._finished = False
        self._policy = next(iter(stack.policies), "")
        self._command: MITCommand | None = None
        self._guards: GuardMemory | None = None
        self._remote = _RemoteCommands()

    def check(self, given: TickInput, output: TickOutput) -> None:
        name, before = output.control_mode.controller_name, self._name
        check_complete(output.command, len(self._stack.joints))
        _check_mode(name, given, output)
        if name != before:
            _check_change(before, name, given.intents, self._finished)
        _check_quit(before, given.intents, output)
        if given.policy in self._stack.policies and before in SAFE:
            self._policy = given.policy
        elif given.policy:
            refused = any(text.startswith(f"policy {given.policy} refused: ") for text in output.refusals)
            require(refused, "policy {} was selected in {}, and no refusal says why not", given.policy, before)
        _check_faults(name, output)
        self._check_command(name, given, output.command)
        self._check_guards(name, given.state, output.command)
        self._name, self._finished = name, output.standby is not None and output.standby.is_finished
        self._command = output.command

    def _check_command(self, name: str, given: TickInput, command: MITCommand) -> None:
        """Check what the mode's own controller must command. One of the user's, a subclass too, may do otherwise."""
        controller = self._stack.controllers[name]
        if name == RL_POLICY and self._policy:
            controller = self._stack.policies[self._policy]
        zeros = np.zeros(command.joint_count)
        before = self._command if name == self._name else None
        self._remote.update(name == REMOTE_POLICY, given)
        if name == ZERO_TORQUE:
            _same("ZERO_TORQUE's command", command, MITCommand.zeros(command.joint_count))
        if name == DAMPING:
            _same("DAMPING's stiffness", command.stiffness, zeros)
        if type(controller) in (DampingController, StandbyController, RLPolicyController):
            _same(f"the velocity in {name}", command.velocity, zeros)
            _same(f"the effort in {name}", command.effort, zeros)
        if type(controller) is DampingController:
            _same("DAMPING's damping", command.damping, controller.damping)
            if before is not None:
                _same("DAMPING's position, captured at activation,", command.position, before.position)
        elif type(controller) is StandbyController:
            _check_ramp(controller, command, before)
        elif type(controller) is RLPolicyController:
            contract, joints = controller.contract, self._stack.joints
            place = [contract.joint_names.index(joint) for joint in joints]
            _same("LOCOMOTION's stiffness", command.stiffness, contract.joint_stiffness[place])
            _same("LOCOMOTION's damping", command.damping, contract.joint_damping[place])
            idle = [joint not in contract.action_joint_names for joint in joints]
            moved = command.position[idle].any()
            require(not moved, "LOCOMOTION moves joints that its policy does not drive: {}", command.position[idle])
        elif type(controller) is RemotePolicyController:
            self._remote.check(controller, given.state, command)

    def _check_guards(self, name: str, state: MITState, command: MITCommand) -> None:
        guards = self._stack.guards
        if guards is None or name in SAFE or state.joint_position.shape != guards.lower.shape:
            self._guards = None
            return
        self._guards = guards.watch(self._guards, state, command)
        problems = guards.problems(self._guards, state, command)
        require(not problems, "{} goes on although a guard has tripped: {}", name, problems.get(0))


def _check_mode(name: str, given: TickInput, output: TickOutput) -> None:
    mode = output.control_mode.mode
    require(name in MODE_NUMBER, "controller {} is none of {}", name, ", ".join(MODE_NUMBER))
    require(mode.value == MODE_NUMBER[name], "{} reports mode {}", name, mode.name)
    require((output.standby is not None) == (mode.value == 2), "{} with standby {}", mode.name, output.standby)
    unsafe = [status for status in given.safety if status.level.value > 0]
    require(not unsafe or name in SAFE, "{} is in control although safety reports {}", name, unsafe)
    if Intent.DAMP in given.intents:
        failed = name == ZERO_TORQUE and any(fault.controller == DAMPING for fault in output.faults)
        require(name == DAMPING or failed, "DAMP was requested, and {} is in control", name)


def _check_change(before: str, name: str, intents: tuple[Intent, ...], finished: bool) -> None:
    require(before not in SAFE or bool(intents), "{} went to {} by itself", before, name)
    require((before, name) != (DAMPING, ZERO_TORQUE), "DAMPING was active and went limp")
    if name not in SAFE or before == ZERO_TORQUE:
        way = [intent for intent, (origins, target) in EDGES.items() if before in origins and name == target]
        require(bool(way), "{} went to {}, which is not an edge of the FSM", before, name)
        require(way[0] in intents, "{} went to {} without {}; intents: {}", before, name, way[0], intents)
    if name in (RL_POLICY, REMOTE_POLICY):
        require(finished, "{} began before {} had finished", name, before)


def _check_quit(before: str, intents: tuple[Intent, ...], output: TickOutput) -> None:
    if output.quit:
        require(Intent.QUIT in intents, "quit without QUIT; intents: {}", intents)
        require(Intent.DAMP not in intents, "QUIT was obeyed although DAMP came with it")
        require(before in SAFE, "QUIT was obeyed from {}", before)
    elif Intent.QUIT in intents:
        said = any(text.startswith("QUIT refused: ") for text in output.refusals)
        require(said, "QUIT had no effect and no refusal says why: {}", output.refusals)


def _check_faults(name: str, output: TickOutput) -> None:
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


def _check_ramp(controller: StandbyController, command: MITCommand, before: MITCommand | None) -> None:
    """STANDBY: gains rise together from 0 to their targets, and never fall on the way."""
    targets = np.concatenate([controller.target_stiffness, controller.target_damping])
    gains = np.concatenate([command.stiffness, command.damping])
    largest = int(np.argmax(targets))
    ramp = float(gains[largest] / targets[largest]) if targets[largest] else 0.0
    together = bool((np.abs(gains - ramp * targets) <= 1e-9 * targets).all())
    require(together and 0.0 <= ramp <= 1.0, "STANDBY's gains are {}, expected one share of {}", gains, targets)
    require(before is not None or ramp == 0.0, "STANDBY began with {:g} of its gains, expected none", ramp)
    least = 0.0 if before is None else np.concatenate([before.stiffness, before.damping])
    require(bool((gains >= least).all()), "STANDBY's gains fell from {} to {}", least, gains)


class _RemoteCommands:
    """The newest remote command that arrived since REMOTE began, and its age."""

    def __init__(self) -> None:
        self._began: float | None = None  # s, robot's clock; None in other modes
        self._time, self._age = 0.0, math.inf
        self._seen: float | None = None  # arrival time of the newest command, also of one from before
        self._newest: RemoteCommand | None = None

    def update(self, is_on: bool, given: TickInput) -> None:
        time, remote = float(given.state.time), given.remote
        arrival = None if remote is None else remote.arrival_time
        if not is_on:
            self._began = None
        elif self._began is None:
            self._began, self._newest, self._age, self._seen = time, None, math.inf, arrival
        else:
            self._age += max(time - self._time, 0.0)
            if arrival is not None and arrival > self._began and arrival != self._seen:
                self._newest, self._age, self._seen = remote, 0.0, arrival
        self._time = time

    def check(self, controller: RemotePolicyController, state: MITState, command: MITCommand) -> None:
        """REMOTE: the newest command while it is fresh, or the passive hold at the position of this tick."""
        position, zeros = state.joint_position, np.zeros(command.joint_count)
        known = np.where(np.abs(position) <= _LARGEST_KNOWN, position, 0.0)
        if fingerprint(command) == fingerprint(MITCommand(known, zeros, zeros, zeros, controller.damping)):
            return
        if self._newest is None:
            raise SafetyViolationError(f"REMOTE applies {command}, but no command has arrived since it was activated")
        _same("REMOTE's command, unless it is the passive hold,", command, self._newest.command)
        is_fresh = self._age <= 1e-3 * controller.stale_command_timeout_ms + _ROUNDING
        is_held = controller.stale_command_policy == "hold"
        require(is_fresh or is_held, "REMOTE applies a command of {:g} s, expected the passive hold", self._age)


def _same(subject: str, value: object, wanted: object) -> None:
    require(fingerprint(value) == fingerprint(wanted), "{} is {}, expected {}", subject, value, wanted)
