"""Twelve stacks with one defect each, and how soon `fuzz_stack` finds it: `python tests/testing/planted_defects.py`."""

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np
from hypothesis import settings

from humanoid_sim.messages import Mode
from humanoid_sim.testing import DEFAULT_SETTINGS, SafetyViolationError, fuzz_stack, robot_stack

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
    "another width of the state raises": RaisesOnOtherWidths,
    "guards are not asked": SleepingGuards,
    "guards trip on a healthy robot": NervousGuards,
}
NEED_TIME = tuple(DEFECTS)[:5]


@dataclass
class Find:
    """What it took until the first violation, and until `fuzz_stack` gave it."""

    message: str = ""
    """Empty: not found."""
    runs: int = 0
    ticks: int = 0
    seconds: float = 0.0
    """s, to the first violation, or of the whole search."""
    total_seconds: float = 0.0
    """s, with the search for a shorter run."""


def find(build: Callable[[Any], Any], **options: Any) -> Find:
    """Fuzz a stack with the default settings, and the same examples every time."""
    result, began, counts = Find(), perf_counter(), {"runs": 0, "ticks": 0}

    def counted(policy: Any) -> Any:
        stack = build(policy)
        counts["runs"] += 1
        step = stack.step

        def one(memory: Any, given: Any) -> Any:
            counts["ticks"] += 1
            try:
                return step(memory, given)
            except Exception as error:
                note(error)
                raise

        stack.step = one
        return stack

    def note(error: object) -> None:
        if not result.message:
            result.message, result.seconds = str(error), perf_counter() - began
            result.runs, result.ticks = counts["runs"], counts["ticks"]

    before = SafetyViolationError.__init__

    def init(self: SafetyViolationError, *arguments: object) -> None:
        before(self, *arguments)
        note(arguments[0])

    SafetyViolationError.__init__ = init  # type: ignore[method-assign]
    try:
        fuzz_stack(counted, settings(DEFAULT_SETTINGS, derandomize=True, database=None), **options)
    except (AssertionError, IndexError) as error:
        note(error)
    finally:
        SafetyViolationError.__init__ = before  # type: ignore[method-assign]
    result.total_seconds = perf_counter() - began
    if not result.message:
        result.runs, result.ticks, result.seconds = counts["runs"], counts["ticks"], result.total_seconds
    return result


def main() -> None:
    """Print the table."""
    print("| defect | found | runs | ticks | s to the first finding | s in all |\n|---|---|---|---|---|---|")
    for name, kind in DEFECTS.items():
        if len(sys.argv) > 1 and sys.argv[1] not in name:
            continue
        one = find(kind)
        found = "yes" if one.message else "no"
        print(
            f"| {name} | {found} | {one.runs} | {one.ticks} | {one.seconds:.1f} | {one.total_seconds:.1f} |", flush=True
        )
        print(f"   {name}: {one.message[:150]}", file=sys.stderr)


if __name__ == "__main__":
    main()
