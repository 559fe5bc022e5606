"""The whole control stack as one pure function: `step(memory, tick_input) -> (memory, tick_output)`.

Whatever fails inside a tick, the command that leaves it is finite, complete and from exactly one controller, and the
tick in which a controller fails already carries its fallback's command. A guard that trips is such a failure.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

from humanoid_sim.controllers.base import DAMPING, REMOTE_POLICY, RL_POLICY, ZERO_TORQUE, Controller, Fault, Memory
from humanoid_sim.controllers.fsm import MODES, MOVING, choose_intent, merge_safety, transition
from humanoid_sim.controllers.guards import GuardMemory, Guards
from humanoid_sim.controllers.parameters import command_problem, joint_tuple
from humanoid_sim.controllers.remote_policy import RemotePolicyController
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.errors import FieldError, known_names
from humanoid_sim.messages import (
    ControlMode,
    FaultReport,
    Intent,
    PolicyStep,
    StandbyState,
    TickInput,
    TickOutput,
)
from humanoid_sim.mit import MITCommand

STARTED = "started"
NOT_DRIVEN = "no motor is driven: reactivate failed"
_START_REASONS = (STARTED, NOT_DRIVEN)
"""Reasons why the control stack is at its start: status message of its first tick, unless that says something else."""


def start_reason(status_message: str) -> str:
    """Return why the control stack was at its start, from the status message that was recorded of its first tick.

    A message that says something else hides the reason, which then has no effect on any tick.
    """
    return status_message if status_message in _START_REASONS else STARTED


@dataclass(frozen=True, slots=True, eq=False)
class SupervisorMemory:
    """The controller in control, its memory, and the latest message to the operator."""

    controller: str
    controller_memory: Any
    """Memory of that controller; None: it is to be activated in the next tick."""
    status_message: str = ""
    guards: GuardMemory | None = None
    """Memory of the guards. They watch the joints, not a controller, so it outlives a change of controller; DAMPING and
    ZERO_TORQUE, which push nowhere, end it."""


@dataclass(frozen=True, slots=True, eq=False)
class _Result:
    """Result of one controller in this tick, after validation."""

    memory: Any
    command: MITCommand
    standby: StandbyState | None = None
    policy_step: PolicyStep | None = None
    notice: str = ""
    guards: GuardMemory | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Outcome:
    """The controller whose command is sent, its result, and the failures on the way to it."""

    controller: str
    result: _Result
    faults: tuple[FaultReport, ...]
    policy_step: PolicyStep | None
    """That of the result, or of what failed before it."""
    policy_error: str | None


@dataclass(frozen=True, slots=True, eq=False)
class Supervisor:
    """Transition, activation, update and the fallback chain inside one tick."""

    joints: tuple[str, ...]
    controllers: Mapping[str, Controller]
    """By name; `zero_torque_controller` and `damping_controller` are required, the others are as available."""
    guards: Guards | None = field(default=None, kw_only=True)
    """Guards of the joints in STANDBY, LOCOMOTION and REMOTE; None: nothing guards them."""
    needs_producer: bool = field(default=False, kw_only=True)
    """True where START_REMOTE requires commands that already arrive: nothing else keeps a floating base on its feet."""
    _zero: MITCommand = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", joint_tuple("Supervisor", self.joints))
        for name, controller in self.controllers.items():
            if name not in MODES:
                raise FieldError(f"Supervisor.controllers: {known_names('controller', name, MODES)}")
            if tuple(controller.joints) != self.joints:
                raise FieldError(
                    f"Supervisor.controllers['{name}']: joints are {', '.join(controller.joints)}, "
                    f"expected {', '.join(self.joints)}"
                )
        for name in (ZERO_TORQUE, DAMPING):
            if name not in self.controllers:
                raise FieldError(f"Supervisor.controllers: {name} is missing, expected it always")
        for name in self.controllers:
            self._check_fallbacks(name)
        if self.guards is not None and self.guards.joints != self.joints:
            raise FieldError(
                f"Supervisor.guards: joints are {', '.join(self.guards.joints)}, expected {', '.join(self.joints)}"
            )
        object.__setattr__(self, "controllers", MappingProxyType(dict(self.controllers)))
        object.__setattr__(self, "_zero", MITCommand.zeros(len(self.joints)))

    def _check_fallbacks(self, name: str) -> None:
        """Every chain of fallbacks ends at ZERO_TORQUE."""
        chain = [name]
        while chain[-1] != ZERO_TORQUE:
            fallback = self.controllers[chain[-1]].fallback or ZERO_TORQUE
            if fallback not in self.controllers or fallback in chain:
                raise FieldError(
                    f"Supervisor.controllers['{name}']: fallbacks are {' -> '.join([*chain, fallback])}, "
                    f"expected a chain of available controllers that ends at {ZERO_TORQUE}"
                )
            chain.append(fallback)

    def initial(self, reason: str = STARTED) -> SupervisorMemory:
        """Return the start: ZERO_TORQUE; `reason` is what an operator is told of it."""
        return SupervisorMemory(ZERO_TORQUE, None, reason)

    def step(self, memory: SupervisorMemory, tick_input: TickInput) -> tuple[SupervisorMemory, TickOutput]:
        """One tick. Neither argument is changed; the same arguments give bit-identical results."""
        safety = merge_safety(tick_input.safety)
        intent, superseded = choose_intent(tick_input.intents)
        finished, unready = _has_finished(memory.controller_memory), self.unready(intent, tick_input)
        decision = transition(memory.controller, safety, intent, finished, self.controllers, unready)

        switch = decision.controller is not None
        wanted = decision.controller or memory.controller
        outcome = self._run(wanted, None if switch else memory.controller_memory, memory, tick_input)
        result = outcome.result

        refusals = tuple(
            text for text in (decision.refusal, *(_superseded(other, intent) for other in superseded)) if text
        )
        words = [decision.message, *(_describe(fault) for fault in outcome.faults), result.notice, *refusals]
        status = "; ".join(word for word in words if word) or memory.status_message
        output = TickOutput(
            command=result.command,
            control_mode=ControlMode(MODES[outcome.controller], outcome.controller, status),
            standby=result.standby,
            quit=decision.quit,
            faults=outcome.faults,
            refusals=refusals,
            policy_step=outcome.policy_step,
            policy_error=outcome.policy_error,
        )
        return SupervisorMemory(outcome.controller, result.memory, status, result.guards), output

    def unready(self, intent: Intent | None, tick_input: TickInput) -> str:
        """Return why the policy, or REMOTE, cannot start yet, if that is the intent; '' if it can."""
        remote = self.controllers.get(REMOTE_POLICY)
        if intent is Intent.START_REMOTE and self.needs_producer and isinstance(remote, RemotePolicyController):
            return remote.unready(tick_input)
        controller = self.controllers.get(RL_POLICY) if intent is Intent.START_LOCOMOTION else None
        return controller.unready(tick_input.state) if isinstance(controller, RLPolicyController) else ""

    def _run(self, name: str, controller_memory: Any, before: SupervisorMemory, tick_input: TickInput) -> _Outcome:
        """Run a controller, or the first of its fallbacks that does not fail.

        A fallback that was in control `before` goes on from there: the captured positions of DAMPING are as good as
        they were, even if the state is not.
        """
        faults: list[FaultReport] = []
        policy_step: PolicyStep | None = None
        policy_error: str | None = None
        while True:
            result, is_bug = self._attempt(name, controller_memory, before.guards, tick_input)
            if not isinstance(result, Fault):
                return _Outcome(name, result, tuple(faults), result.policy_step or policy_step, policy_error)
            policy_step = policy_step or result.policy_step
            policy_error = result.policy_error if policy_error is None else policy_error
            fallback = self.controllers[name].fallback or ZERO_TORQUE
            faults.append(FaultReport(name, fallback, result.message, is_bug))
            if name == ZERO_TORQUE:
                # Cannot happen with this package's controller; a foreign one in its place may do anything.
                return _Outcome(name, _Result(Memory(), self._zero), tuple(faults), policy_step, policy_error)
            name, controller_memory = fallback, before.controller_memory if fallback == before.controller else None

    def _attempt(
        self, name: str, controller_memory: Any, guards: GuardMemory | None, tick_input: TickInput
    ) -> tuple[_Result | Fault, bool]:
        """Return a controller's result, with all that must not leave it turned into a fault; and whether it raised."""
        controller = self.controllers[name]
        try:
            if controller_memory is None:
                controller_memory = controller.activate(tick_input)
            if isinstance(controller_memory, Fault):
                return _readable(controller_memory), False
            update = controller.update(controller_memory, tick_input)
            if isinstance(update, Fault):
                return _readable(update), False
            result = _checked(update)
            problem = command_problem(result.command, self.joints)
            if not problem and self.guards is not None and MODES[name] in MOVING:
                watched = self.guards.watch(guards, tick_input.state, result.command)
                if watched is not None:  # something is near a bound
                    problem = self.guards.problem(watched, tick_input.state, result.command)
                    result = replace(result, guards=watched)
            return (Fault(problem, result.policy_step) if problem else result), False
        except Exception as error:  # a bug; contained here because the robot needs a command in this tick
            return Fault(_explain(error)), True


def _checked(update: Any) -> _Result:
    """Return what a controller's `update` gave, if it is what it must be: anything else is a bug, and raises."""
    memory, command = update
    if memory is None or isinstance(memory, Fault):
        raise TypeError(f"update gave {type(memory).__name__} for a memory")
    if type(command) is not MITCommand:  # a subclass may say of itself what it likes
        raise TypeError(f"update gave a {type(command).__name__}, expected an MITCommand")
    standby, policy_step = getattr(memory, "standby", None), getattr(memory, "policy_step", None)
    return _Result(memory, command, standby, policy_step, _printable(getattr(memory, "notice", "")))


def _has_finished(controller_memory: Any) -> bool:
    """Return whether the standby controller has arrived; a memory that cannot be asked has not."""
    try:
        return bool(controller_memory.standby.is_finished)
    except Exception:  # not a standby memory, or one whose properties raise: either way START is refused
        return False


def _readable(fault: Fault) -> Fault:
    """Return the fault with a message that can be printed and recorded, whatever a foreign controller put there."""
    message = _printable(fault.message)
    error = None if fault.policy_error is None else _printable(fault.policy_error)
    return Fault(message, fault.policy_step, error)


def _printable(text: object) -> str:
    return str(text).encode(errors="backslashreplace").decode()


def _explain(error: Exception) -> str:
    try:
        return _printable(f"{type(error).__name__}: {error}")
    except Exception:  # an exception that cannot even be printed
        return type(error).__name__


def _superseded(other: Intent, chosen: Intent | None) -> str:
    return f"{other.name} refused: {chosen.name} came in the same tick" if chosen else ""


def _describe(fault: FaultReport) -> str:
    kind = "raised" if fault.is_bug else "failed"
    return f"{fault.controller} {kind}: {fault.message}; {fault.fallback} takes over"
