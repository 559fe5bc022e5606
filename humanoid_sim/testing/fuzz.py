"""Fuzz a control stack, or a controller by itself, with one call."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import run_state_machine_as_test
from hypothesis.strategies import DataObject

from humanoid_sim.controllers.base import REMOTE_POLICY, Controller, Fault
from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.messages import Intent, SafetyFlag, SafetyLevel, SafetyStatus, TickInput
from humanoid_sim.mit import MITCommand
from humanoid_sim.policy.checkpoint import placeholder_checkpoint
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.robots.description import load_robot
from humanoid_sim.stack import build_supervisor
from humanoid_sim.testing.healthy import ScriptedPolicy, healthy_externs, healthy_state
from humanoid_sim.testing.machine import PERIOD, StackMachine
from humanoid_sim.testing.properties import check_complete, require, run_twice
from humanoid_sim.testing.strategies import any_tick_inputs, clock_jumps, healthy_states

DEFAULT_SETTINGS = settings(
    max_examples=50,
    stateful_step_count=40,
    deadline=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.large_base_example, HealthCheck.too_slow, HealthCheck.data_too_large],
)
_HEALTHY_TICKS = 2000  # in each mode, before anything is attacked: 40 s at 50 Hz
_WAYS = (  # intents that lead into each mode
    (),
    (Intent.DAMP,),
    (Intent.LOAD_A,),
    (Intent.LOAD_B,),
    (Intent.LOAD_A, Intent.START_LOCOMOTION),
    (Intent.LOAD_A, Intent.START_REMOTE),
)


def robot_stack(name_or_path: str | Path) -> Callable[[ScriptedPolicy], Supervisor]:
    """For `fuzz_stack`: all controllers of a shipped robot, a YAML description or an MJCF, with its settings.

    LOCOMOTION runs the fuzzed policy on all joints, or a second one with half its stiffness, around the final pose of
    standby A and within the limits: a policy that presses a joint against its stop is ended by a guard.
    """
    description = load_robot(name_or_path)
    period = 1.0 / description.hardware.control_frequency
    unbounded = placeholder_checkpoint(description, policy_dt=period).contract
    contract = replace(unbounded, position_clip="joint_limits")

    def build(policy: ScriptedPolicy) -> Supervisor:
        firm = load_policy(contract, policy, None)
        soft = load_policy(replace(contract, joint_stiffness=0.5 * contract.joint_stiffness), policy, None)
        return build_supervisor(description, period, {"firm": firm, "soft": soft}, remote=True)

    return build


def fuzz_stack(build: Callable[[ScriptedPolicy], Supervisor], settings: settings = DEFAULT_SETTINGS) -> None:
    """Drive a control stack with anything, and check `SafetyProperties` on every tick.

    `build` returns a new stack for every run, with the policy it is given, which may misbehave. Raises
    `SafetyViolationError` with the shortest run that was found to break a property.
    """

    class Stack(StackMachine):
        def build(self, policy: ScriptedPolicy) -> Supervisor:
            return build(policy)

    survey(Stack)
    run_state_machine_as_test(Stack, settings=settings)


def survey(machine_type: type[StackMachine]) -> None:
    """In each mode, on a healthy robot: nothing happens for 40 s, and every report, policy and sequence of intents."""
    for way in _WAYS:
        machine = machine_type()
        if way == (Intent.DAMP,):
            machine.tick(Intent.DAMP)
        elif way and not machine.go(*way):
            continue
        machine.tick()
        calm = machine.healthy()
        well, reports = SafetyStatus(source="can0"), product(SafetyLevel, SafetyFlag)
        trials = [replace(calm, safety=(well, SafetyStatus(*report, "can1"))) for report in reports]
        trials += [replace(calm, policy=name) for name in (*machine.stack.policies, "unheard_of")]
        trials += [replace(calm, intents=wanted) for count in (1, 2, 3) for wanted in product(Intent, repeat=count)]
        for trial in trials:
            memory, properties = machine.memory, copy.copy(machine.properties)
            for tick in (trial, calm):
                memory, output = machine.stack.step(memory, tick)
                properties.check(tick, output)
        machine.pass_time(_HEALTHY_TICKS)
        if machine.memory.controller == REMOTE_POLICY:
            machine.pass_time(_HEALTHY_TICKS, sends=False)


def fuzz_controller(controller: Controller, settings: settings = DEFAULT_SETTINGS) -> None:
    """Hold a controller by itself to what the supervisor expects of every one, as docs/testing.md lists it.

    Raises `SafetyViolationError` with the shortest example that was found.
    """
    n, extern = len(controller.joints), getattr(controller, "extern", {})
    memory = None
    for i in range(_HEALTHY_TICKS):
        memory = _step(controller, memory, TickInput(healthy_state((0.5,) * n, 10.0 + PERIOD * i, extern)))
        require(not isinstance(memory, Fault), "on a healthy robot: {}, in tick {}", memory, i)

    @settings
    @given(st.data(), st.booleans(), st.lists(clock_jumps(), max_size=6))
    def session(data: DataObject, is_healthy: bool, jumps: list[float]) -> None:
        memory, time = None, 10.0
        for jump in (0.0, *jumps):
            if is_healthy:
                time += PERIOD
                tick = TickInput(data.draw(healthy_states(n, time, healthy_externs(extern, time))))
            else:
                tick = data.draw(any_tick_inputs(n, 10.0 + jump))
            result = _step(controller, memory, tick)
            require(not (is_healthy and isinstance(result, Fault)), "on a healthy robot: {}", result)
            memory = None if isinstance(result, Fault) else result

    session()


def _step(controller: Controller, memory: Any, tick: TickInput) -> Any:
    """Return the next memory, or a fault, of one tick as the supervisor runs it: activation too, without a memory."""

    def update(memory: Any, tick: TickInput) -> Any:
        begun = controller.activate(tick) if memory is None else memory
        return begun if isinstance(begun, Fault) else controller.update(begun, tick)

    result = run_twice(update, memory, tick)
    if isinstance(result, Fault):
        require(bool(result.message), "a fault whose message is {!r}", result.message)
        return result
    is_pair = isinstance(result, tuple) and len(result) == 2 and isinstance(result[1], MITCommand)
    require(is_pair, "the answer is {!r}, expected (memory, MITCommand) or a Fault", result)
    memory, command = result
    check_complete(command, len(controller.joints))
    return memory
