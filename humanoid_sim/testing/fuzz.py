"""Fuzz a control stack, or a controller by itself, with one call."""

from __future__ import annotations

import copy
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import chain, product
from pathlib import Path
from time import perf_counter
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import run_state_machine_as_test
from hypothesis.strategies import DataObject

from humanoid_sim.controllers.base import Controller, Fault
from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.messages import Intent, SafetyFlag, SafetyLevel, SafetyStatus, TickInput
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.policy.checkpoint import placeholder_checkpoint
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.robots.description import load_robot
from humanoid_sim.stack import build_supervisor
from humanoid_sim.testing.healthy import healthy_externs, healthy_tick
from humanoid_sim.testing.machine import SHRINK_SECONDS, StackMachine, shrinking_for
from humanoid_sim.testing.policies import ScriptedPolicy
from humanoid_sim.testing.properties import REMOTE, SafetyViolationError, check_complete, fingerprint, require
from humanoid_sim.testing.strategies import any_tick_inputs, clock_jumps, healthy_states

DEFAULT_SETTINGS = settings(
    max_examples=50,
    stateful_step_count=40,
    deadline=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.large_base_example, HealthCheck.too_slow, HealthCheck.data_too_large],
)
"""Runs of up to 40 steps; whole states and commands are drawn in one step, which is large, and meant.

More examples: `settings(DEFAULT_SETTINGS, max_examples=1000)`. The same ones every time: `derandomize=True`.
"""

HEALTHY_TICKS = 2000
"""In each mode, before anything is attacked: 40 s at 50 Hz."""

_PERIOD = 0.02
"""s of the robot's clock from one tick to the next of a healthy session."""


def robot_stack(name_or_path: str | Path) -> Callable[[ScriptedPolicy], Supervisor]:
    """For `fuzz_stack`: all controllers of a robot, with the settings of its description.

    LOCOMOTION runs the fuzzed policy on all joints, around the final pose of standby A and within their limits: a
    policy that presses a joint against its stop is ended by a guard, however healthy the robot. Raises `InputError` if
    there is no such robot, or its description is wrong.

    Args:
        name_or_path: a shipped robot, a YAML description, or an MJCF.
    """
    description = load_robot(name_or_path)
    period = 1.0 / description.hardware.control_frequency
    unbounded = placeholder_checkpoint(description, policy_dt=period).contract
    contract = replace(unbounded, position_clip="joint_limits")

    def build(policy: ScriptedPolicy) -> Supervisor:
        return build_supervisor(description, period, load_policy(contract, policy, None), remote=True)

    return build


def fuzz_stack(
    build: Callable[[ScriptedPolicy], Supervisor],
    settings: settings = DEFAULT_SETTINGS,
    *,
    healthy_ticks: int = HEALTHY_TICKS,
    shrink_seconds: float = SHRINK_SECONDS,
) -> None:
    """Drive a control stack with anything, and check `SafetyProperties` on every tick.

    First, with nothing random, every mode lasts for `healthy_ticks` on a healthy robot, and is given every safety
    report and every combination of intents: what needs no luck is found always. The first violation of the search that
    follows is written to stderr when it is found. Raises `SafetyViolationError` with the shortest run that was found to
    break a property.

    Args:
        build: gives the stack under test, new for every run. The policy that it is given behaves or misbehaves as the
            run has it; a stack that runs a policy of its own may leave it aside.
        healthy_ticks: in each mode; 0 leaves out whatever comes before the search.
        shrink_seconds: s, for which a shorter run is looked for.
    """
    began, runs, has_told = perf_counter(), 0, False

    class Stack(StackMachine):
        def __init__(self) -> None:
            nonlocal runs
            super().__init__()
            runs += 1

        def build(self, policy: ScriptedPolicy) -> Supervisor:
            return build(policy)

        def broken(self, error: AssertionError) -> None:
            nonlocal has_told
            if not has_told:  # the search for a shorter run may take long
                has_told, seconds = True, perf_counter() - began
                sys.stderr.write(f"found in run {runs}, after {seconds:.1f} s (looking for a shorter one): {error}\n")
                sys.stderr.flush()

    if healthy_ticks > 0:
        every_mode_lasts(Stack, healthy_ticks)
        every_report_and_intent(Stack)
    with shrinking_for(shrink_seconds):
        run_state_machine_as_test(Stack, settings=settings)


def fuzz_controller(
    controller: Controller,
    settings: settings = DEFAULT_SETTINGS,
    *,
    healthy_ticks: int = HEALTHY_TICKS,
    shrink_seconds: float = SHRINK_SECONDS,
) -> None:
    """Hold a controller by itself to what the supervisor expects of every one, whatever its input.

    It never raises. It answers with a memory and a complete command, or with a `Fault` that says why. The same inputs
    give the same bits, and nothing that it is given changes. On a healthy robot whose clock runs, it has no fault.
    Raises `SafetyViolationError` with the shortest example that was found.

    Args:
        healthy_ticks: of the longest healthy session; 0 for none.
        shrink_seconds: s, for which a shorter example is looked for.
    """
    n = len(controller.joints)
    memory = None
    for i in range(healthy_ticks):
        time = 10.0 + _PERIOD * i
        tick = healthy_tick((0.5,) * n, time, externs=getattr(controller, "extern", {}))
        memory = _step(controller, memory, tick)
        require(not isinstance(memory, Fault), "on a healthy robot: {}, in tick {}", memory, i)

    @settings
    @given(st.data(), st.lists(clock_jumps(), max_size=6))
    def any_session(data: DataObject, jumps: list[float]) -> None:
        time, memory = 10.0, None
        for jump in (0.0, *jumps):
            result = _step(controller, memory, data.draw(any_tick_inputs(n, time + jump)))
            memory = None if isinstance(result, Fault) else result

    @settings
    @given(st.lists(healthy_states(n, 10.0), min_size=1, max_size=6))
    def healthy_session(states: list[MITState]) -> None:
        memory = None
        for i, state in enumerate(states):
            time = float(state.time) + _PERIOD * i
            externs = healthy_externs(getattr(controller, "extern", {}), time)
            memory = _step(controller, memory, TickInput(replace(state, time=time, extern=externs)))
            require(not isinstance(memory, Fault), "on a healthy robot: {}", memory)

    with shrinking_for(shrink_seconds):
        healthy_session()
        any_session()


def _step(controller: Controller, memory: Any, tick: TickInput) -> Any:
    """One tick as the supervisor runs it, activation included where there is no memory: the next memory, or a fault."""
    before = fingerprint(tick), fingerprint(memory)
    memory_and_command = _attempt(controller, memory, tick)
    again = _attempt(controller, memory, tick)
    require(before == (fingerprint(tick), fingerprint(memory)), "what it was given changed")
    same = fingerprint(memory_and_command) == fingerprint(again)
    require(same, "the same inputs gave {} and {}", memory_and_command, again)
    if isinstance(memory_and_command, Fault):
        message = memory_and_command.message
        require(isinstance(message, str) and bool(message), "a fault whose message is {!r}", message)
        return memory_and_command
    try:
        after, command = memory_and_command
    except (TypeError, ValueError):
        raise SafetyViolationError(f"update gave {memory_and_command!r}, expected a memory and a command") from None
    require(type(command) is MITCommand, "update gave {!r} for a command", command)
    require(after is not None and not isinstance(after, Fault), "update gave {!r} for a memory", after)
    check_complete(command, len(controller.joints))
    return after


def _attempt(controller: Controller, memory: Any, tick: TickInput) -> Any:
    try:
        if memory is None:
            memory = controller.activate(tick)
        return memory if isinstance(memory, Fault) else controller.update(memory, tick)
    except Exception as error:
        raise SafetyViolationError(f"raised {type(error).__name__}: {error}") from error


_WAYS = (
    (),
    (Intent.DAMP,),
    (Intent.LOAD_A,),
    (Intent.LOAD_B,),
    (Intent.LOAD_A, Intent.START_LOCOMOTION),
    (Intent.LOAD_A, Intent.START_REMOTE),
)
"""Intents by which an operator comes into each mode."""
_SOURCES = ("can0", "can1", "simulator")
_INTENTS_AT_ONCE = 3


def every_mode_lasts(machine_type: type[StackMachine], ticks: int) -> None:
    """Each mode on a healthy robot, for so many ticks: it stays, and no controller fails."""
    for machine, way in _modes(machine_type):
        try:
            machine.pass_time(ticks)
            if machine.memory.controller == REMOTE:
                machine.pass_time(ticks, sends=False)
        except AssertionError as error:
            raise SafetyViolationError(f"{error}; after {way}, without any attack") from error


def every_report_and_intent(machine_type: type[StackMachine]) -> None:
    """In each mode every level and flag, from every one of up to three sources, and up to three intents in any order.

    Each is one tick on a healthy robot, from the same instant of the mode.
    """
    for machine, way in _modes(machine_type):
        machine.tick()
        state = healthy_tick(machine.robot.position, machine.time + machine.period, externs=machine.externs).state
        given = TickInput(state, remote=machine.remote)
        reports = (replace(given, safety=safety) for safety in _reports())
        wanted = (product(Intent, repeat=count) for count in range(1, _INTENTS_AT_ONCE + 1))
        asked_for = (replace(given, intents=intents) for intents in chain.from_iterable(wanted))
        for one in chain(reports, asked_for):
            try:
                _try_out(machine, one)
            except AssertionError as error:
                asked = [intent.name for intent in one.intents] or one.safety
                raise SafetyViolationError(f"{error}; after {way} on a healthy robot, with {asked}") from error


def _modes(machine_type: type[StackMachine]) -> Iterator[tuple[StackMachine, str]]:
    """Yield a machine in each mode that the stack has, and how it came there."""
    for way in _WAYS:
        name = ", ".join(intent.name for intent in way) or "the start"
        machine = machine_type()
        try:
            if way == (Intent.DAMP,):
                machine.tick(Intent.DAMP)
            elif way and not machine.go(*way):
                continue
        except AssertionError as error:
            raise SafetyViolationError(f"{error}; after {name}, without any attack") from error
        yield machine, name


def _reports() -> Iterator[tuple[SafetyStatus, ...]]:
    """One source of one, two or three reports something; the others are well."""
    for count in range(1, len(_SOURCES) + 1):
        for speaker, level, flag in product(range(count), SafetyLevel, SafetyFlag):
            report = SafetyStatus(level, flag, _SOURCES[speaker], "reported")
            well = [SafetyStatus(SafetyLevel.OK, SafetyFlag.NONE, source, "") for source in _SOURCES[:count]]
            yield (*well[:speaker], report, *well[speaker + 1 :])


def _try_out(machine: StackMachine, given: TickInput) -> None:
    """One tick that is checked like any other, and taken back."""
    trial = copy.copy(machine)
    trial.properties, trial.robot, trial.history = machine.properties.copy(), copy.copy(machine.robot), []
    trial.feed(given)
