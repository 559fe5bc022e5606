"""The whole control stack as one pure function: `step(memory, tick_input) -> (memory, tick_output)`.

Whatever fails inside a tick, the command that leaves it is finite, complete and from one controller: the tick in which
a controller fails, or a guard trips, already carries the fallback's command.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from humanoid_sim.controllers.base import DAMPING, RL_POLICY, ZERO_TORQUE, Controller, Fault, Memory
from humanoid_sim.controllers.fsm import (
    MODES,
    MOVING,
    RESTING,
    RULES,
    choose_intent,
    merge_safety,
    mode_names,
    refused,
    transition,
)
from humanoid_sim.controllers.guards import GuardMemory, Guards
from humanoid_sim.controllers.parameters import command_problem, require
from humanoid_sim.controllers.remote_policy import RemotePolicyController
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.errors import FieldError, known_names
from humanoid_sim.messages import ControlMode, FaultReport, Intent, TickInput, TickOutput
from humanoid_sim.mit import MITCommand

STARTED = "started"
NOT_DRIVEN = "no motor is driven: reactivate failed"


@dataclass(frozen=True, slots=True, eq=False)
class SupervisorMemory:
    """State that the supervisor carries from one tick to the next."""

    controller: str
    controller_memory: Any  # memory of that controller; None: it is to be activated in the next tick
    status_message: str  # the latest message to the operator
    command: MITCommand  # the command of the previous tick, which was accepted; zeros at the start
    guards: GuardMemory | None = None  # outlives a change of controller; DAMPING and ZERO_TORQUE end it
    policy: str = ""  # name of the selected policy; '' where there is only one


@dataclass(frozen=True, slots=True, eq=False)
class Supervisor:
    """Transition, activation, update and the fallback chain inside one tick."""

    joints: tuple[str, ...]
    controllers: Mapping[str, Controller]
    """By name; `zero_torque_controller` and `damping_controller` are required, the others are as available."""
    guards: Guards | None = field(default=None, kw_only=True)  # of the joints in STANDBY, LOCOMOTION and REMOTE
    policies: Mapping[str, Controller] = field(default_factory=dict, kw_only=True)
    """Controllers that `rl_policy_controller` can be, by the policy's name; the first is selected at the start. Empty:
    only the one in `controllers`."""

    def __post_init__(self) -> None:
        if self.policies:
            first = next(iter(self.policies.values()))
            object.__setattr__(self, "controllers", {**self.controllers, RL_POLICY: first})
        for name in (ZERO_TORQUE, DAMPING):
            require(name in self.controllers, "Supervisor.controllers", f"without {name}", "it always")
        for name, controller in self.controllers.items():
            if name not in MODES:
                raise FieldError(f"Supervisor.controllers: {known_names('controller', name, MODES)}")
            where, joints = f"Supervisor.controllers['{name}'].joints", controller.joints
            require(joints == self.joints, where, ", ".join(joints), ", ".join(self.joints))

    def initial(self, reason: str = STARTED) -> SupervisorMemory:
        """Return the start, ZERO_TORQUE; `reason` is the first status message."""
        zeros = MITCommand.zeros(len(self.joints))
        return SupervisorMemory(ZERO_TORQUE, None, reason, zeros, policy=next(iter(self.policies), ""))

    def step(self, memory: SupervisorMemory, tick_input: TickInput) -> tuple[SupervisorMemory, TickOutput]:
        """Return the memory after one tick, and its output; the same arguments give bit-identical results."""
        safety = merge_safety(tick_input.safety)
        intent, superseded = choose_intent(tick_input.intents)
        standby = None if memory.controller_memory is None else memory.controller_memory.standby
        finished = standby is not None and standby.is_finished
        policy, selected, not_selected = self._select(memory, tick_input.policy)
        unready = self.unready(intent, tick_input, policy)
        decision = transition(memory.controller, safety, intent, finished, self.controllers, unready)

        name, before = memory.controller, memory.controller_memory
        if decision.controller is not None:
            name, before = decision.controller, None
        faults: list[FaultReport] = []
        failed: Fault | None = None
        while isinstance(result := self._attempt(name, policy, before, memory, tick_input), Fault):
            failed = failed or result
            fallback = ZERO_TORQUE if name in (DAMPING, ZERO_TORQUE) else DAMPING
            faults.append(FaultReport(name, fallback, result.message, result.is_bug))
            if name == ZERO_TORQUE:  # never this package's own
                result = Memory(), MITCommand.zeros(len(self.joints)), None
                break
            # A fallback that was in control goes on: the captured positions of DAMPING are as good as they were.
            name, before = fallback, memory.controller_memory if fallback == memory.controller else None

        after, command, guards = result
        others = [refused(other, f"{intent.name} came in the same tick") for other in superseded if intent]
        refusals = tuple(filter(None, (decision.refusal, *others, not_selected)))
        starts = f"{decision.message}, policy {policy}" if policy and decision.controller == RL_POLICY else ""
        words = (selected, starts or decision.message, *map(_describe, faults), after.notice, *refusals)
        status = "; ".join(filter(None, words)) or memory.status_message
        output = TickOutput(
            command=command,
            control_mode=ControlMode(MODES[name], name, status),
            standby=after.standby,
            quit=decision.quit,
            faults=tuple(faults),
            refusals=refusals,
            policy_step=after.policy_step or (failed.policy_step if failed else None),
            policy_error=failed.policy_error if failed else None,
        )
        return SupervisorMemory(name, after, status, command, guards, policy), output

    def _select(self, memory: SupervisorMemory, wanted: str) -> tuple[str, str, str]:
        """Return the selected policy, what changed, and why `wanted` is refused; the last two '' for nothing."""
        mode, reason = MODES[memory.controller], ""
        if wanted and wanted not in self.policies:
            reason = known_names("policy", wanted, self.policies)
        elif wanted and mode not in RESTING:
            reason = f"requires {mode_names(RESTING)}, mode is {mode.name}"
        if reason or not wanted:
            return memory.policy, "", f"policy {wanted} refused: {reason}" if reason else ""
        return wanted, f"policy {wanted} selected", ""

    def _controller(self, name: str, policy: str) -> Controller | None:
        return self.policies[policy] if policy and name == RL_POLICY else self.controllers.get(name)

    def unready(self, intent: Intent | None, tick_input: TickInput, policy: str = "") -> str:
        """Return why a policy, or REMOTE, cannot start yet, if that is the intent; '' if it can."""
        target = None if intent is None else RULES[intent].target
        controller = None if target is None else self._controller(target, policy)
        if isinstance(controller, RemotePolicyController | RLPolicyController):
            return controller.unready(tick_input)
        return ""

    def _attempt(
        self, name: str, policy: str, start: Any, before: SupervisorMemory, tick_input: TickInput
    ) -> tuple[Memory, MITCommand, GuardMemory | None] | Fault:
        """Return a controller's result, or what keeps its command from being sent; `start` is its memory, or None."""
        shape, n = tick_input.state.joint_position.shape, len(self.joints)
        if shape != (n,) and (MODES[name] in MOVING or (name == DAMPING and start is None)):
            return Fault(f"state has {shape} joint positions, expected ({n},)")
        try:
            controller: Any = self._controller(name, policy)
            answer = controller.activate(tick_input) if start is None else start
            if not isinstance(answer, Fault):
                answer = controller.update(answer, tick_input)
            if isinstance(answer, Fault):
                error = None if answer.policy_error is None else _text(answer.policy_error)
                return replace(answer, message=_text(answer.message), policy_error=error)
            memory, command = answer
            # Commands are read-only: one that is held was accepted before.
            problem = "" if command is before.command else command_problem(command, self.joints)
            guards = None
            if not problem and self.guards is not None and MODES[name] in MOVING:
                guards = self.guards.watch(before.guards, tick_input.state, command)
                problem = self.guards.problems(guards, tick_input.state, command).get(0, "")
            if problem:
                return Fault(problem, memory.policy_step)
            if not isinstance(memory, Memory):
                raise TypeError(f"update gave a {type(memory).__name__} for a memory")
            return memory, command, guards
        except Exception as error:  # a bug; contained here because the robot needs a command in this tick
            return Fault(f"{type(error).__name__}: {_text(error)}", is_bug=True)


def _text(value: object) -> str:
    """Return a foreign message as text that can be printed and recorded."""
    try:
        return str(value).encode(errors="backslashreplace").decode()
    except Exception:  # an exception that cannot even be printed
        return type(value).__name__


def _describe(fault: FaultReport) -> str:
    kind = "raised" if fault.is_bug else "failed"
    return f"{fault.controller} {kind}: {fault.message}; {fault.fallback} takes over"
