"""Twelve stacks with one defect each, and how soon `fuzz_stack` finds it: `python tests/testing/planted_defects.py`."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np
from hypothesis import Phase, settings

from humanoid_sim.messages import Mode
from humanoid_sim.testing import DEFAULT_SETTINGS, fuzz_stack, robot_stack

SOUND = robot_stack("lite")
NAN_COMMAND, LIMP, TIRED_POLICY, SOFT_POSE, DEAF_REMOTE = 1000, 300, 500, 400, 700
"""Ticks after which the defects that need time show."""


@dataclass(frozen=True)
class Counted:
    """What the controllers of the stack below remember, and for how many ticks its present one has been in control."""

    inner: Any
    ticks: int = 0

    @property
    def controller(self) -> str:
        """As a `SupervisorMemory` has it."""
        return self.inner.controller

    @property
    def controller_memory(self) -> Any:
        """As a `SupervisorMemory` has it."""
        return self.inner.controller_memory


class Stack:
    """A sound stack whose defect is in `after` or `before` a tick. Its children have one each."""

    def __init__(self, policy: Any) -> None:
        self.sound = SOUND(policy)
        self.joints, self.controllers, self.guards = self.sound.joints, self.sound.controllers, self.sound.guards
        self.policies = self.sound.policies

    def initial(self) -> Counted:
        return Counted(self.sound.initial())

    def step(self, memory: Counted, given: Any) -> tuple[Counted, Any]:
        inner, output = self.sound.step(memory.inner, self.before(memory, given))
        count = memory.ticks + 1 if inner.controller == memory.controller else 0
        return self.after(Counted(inner, count), given, output)

    def before(self, memory: Counted, given: Any) -> Any:
        return given

    def after(self, memory: Counted, given: Any, output: Any) -> tuple[Counted, Any]:
        return memory, output


def changed(output: Any, **fields: Any) -> Any:
    return replace(output, command=replace(output.command, **fields))


class NaNEvery1000thTick(Stack):
    def after(self, memory, given, output):
        if memory.ticks and memory.ticks % NAN_COMMAND == 0 and output.control_mode.mode is Mode.DAMPING:
            output = changed(output, position=np.full(len(self.joints), np.nan))
        return memory, output


class DampingGoesLimp(Stack):
    def after(self, memory, given, output):
        if output.control_mode.mode is not Mode.DAMPING or memory.ticks < LIMP:
            return memory, output
        start = self.sound.initial()
        return Counted(start), self.sound.step(start, replace(given, intents=()))[1]


class PolicyTires(Stack):
    """In LOCOMOTION the joints are reported as unknown after a while, so that a sound policy's controller fails."""

    def before(self, memory, given):
        if memory.controller == "rl_policy_controller" and memory.ticks >= TIRED_POLICY:
            unknown = np.full(len(given.state.joint_position), np.nan)
            return replace(given, state=replace(given.state, joint_position=unknown))
        return given


class PoseGoesSoft(Stack):
    def after(self, memory, given, output):
        if output.standby is not None and output.standby.is_finished and memory.ticks > SOFT_POSE:
            output = changed(output, stiffness=0.9 * output.command.stiffness)
        return memory, output


class RemoteGoesDeaf(Stack):
    """After a while the command of long ago is still applied, although newer ones have come."""

    def after(self, memory, given, output):
        if output.control_mode.mode is Mode.REMOTE and memory.ticks > DEAF_REMOTE:
            output = changed(output, position=np.full(len(self.joints), 0.25))
        return memory, output


class IgnoresTheSecondSource(Stack):
    def before(self, memory, given):
        return replace(given, safety=given.safety[:1])


class IgnoresDampWithQuit(Stack):
    def before(self, memory, given):
        names = [intent.name for intent in given.intents]
        return replace(given, intents=()) if {"DAMP", "QUIT"} <= set(names) else given


class NegativeGainInRemote(Stack):
    def after(self, memory, given, output):
        if output.control_mode.mode is Mode.REMOTE and output.command.damping.max() > 50.0:
            output = changed(output, damping=-output.command.damping)
        return memory, output


class RemembersOutsideItsMemory(Stack):
    def __init__(self, policy):
        super().__init__(policy)
        self.calls = 0

    def after(self, memory, given, output):
        self.calls += 1
        if self.calls > 200 and output.control_mode.mode is Mode.DAMPING:
            output = changed(output, position=output.command.position + 1e-9 * self.calls)
        return memory, output


class ChangesTheRunningPolicy(Stack):
    """A selection is refused in LOCOMOTION, and holds from the next tick all the same."""

    def after(self, memory, given, output):
        if given.policy in self.policies and output.control_mode.mode is Mode.LOCOMOTION:
            return replace(memory, inner=replace(memory.inner, policy=given.policy)), output
        return memory, output


class RaisesOnOtherWidths(Stack):
    def before(self, memory, given):
        if given.state.joint_count != len(self.joints):
            raise IndexError("index 14 is out of bounds")
        return given


class SleepingGuards(Stack):
    """It has guards, and never asks them."""

    def __init__(self, policy):
        super().__init__(policy)
        self.sound = replace(self.sound, guards=None)


class NervousGuards(Stack):
    """They trip where a joint begins to be pulled, as every one is that is led anywhere."""

    def __init__(self, policy):
        super().__init__(policy)
        guards = replace(self.guards, following_effort=np.full(len(self.joints), 1e-3), following_time=0.0)
        self.sound = replace(self.sound, guards=guards)


DEFECTS: dict[str, type[Stack]] = {
    "DAMPING commands NaN in every 1000th tick": NaNEvery1000thTick,
    "DAMPING goes limp after 300 ticks": DampingGoesLimp,
    "LOCOMOTION fails after 500 ticks": PolicyTires,
    "a finished pose loses stiffness after 400 ticks": PoseGoesSoft,
    "REMOTE applies another command after 700 ticks": RemoteGoesDeaf,
    "the second safety source is ignored": IgnoresTheSecondSource,
    "DAMP together with QUIT is ignored": IgnoresDampWithQuit,
    "a negative gain in REMOTE, from strong ones": NegativeGainInRemote,
    "something is remembered outside the memory": RemembersOutsideItsMemory,
    "a selection changes the policy that runs": ChangesTheRunningPolicy,
    "another width of the state raises": RaisesOnOtherWidths,
    "guards are not asked": SleepingGuards,
    "guards trip on a healthy robot": NervousGuards,
}
NEED_TIME = tuple(DEFECTS)[:5]


def find(build: Callable[[Any], Any]) -> tuple[str, int, float]:
    """Fuzz a stack with the same examples every time: the first violation ('' for none), ticks until it, and s."""
    ticks, began = 0, perf_counter()

    def counted(policy: Any) -> Any:
        stack = build(policy)
        step = stack.step

        def one(memory: Any, given: Any) -> Any:
            nonlocal ticks
            ticks += 1
            return step(memory, given)

        stack.step = one
        return stack

    try:
        fuzz_stack(counted, settings(DEFAULT_SETTINGS, derandomize=True, database=None, phases=[Phase.generate]))
    except (AssertionError, IndexError) as error:
        return str(error) or type(error).__name__, ticks, perf_counter() - began
    return "", ticks, perf_counter() - began


def main() -> None:
    """Print the table."""
    print("| defect | found | ticks | s |\n|---|---|---|---|")
    for name, kind in DEFECTS.items():
        message, ticks, seconds = find(kind)
        print(f"| {name} | {message[:60] or 'no'} | {ticks} | {seconds:.1f} |", flush=True)


if __name__ == "__main__":
    main()
