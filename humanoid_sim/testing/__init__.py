"""Fuzz your own controllers, robot settings and control stacks with Hypothesis (extra `testing`).

`fuzz_stack` and `fuzz_controller` are one call each; a failure is a `SafetyViolationError`, printed with the shortest
run that Hypothesis found to lead to it. `StackMachine` is the same as a class, for rules and properties of one's own.
`docs/testing.md` says what is checked.
"""

from humanoid_sim.errors import needing

with needing("hypothesis", "testing", "humanoid_sim.testing"):
    import hypothesis as _hypothesis  # noqa: F401

from humanoid_sim.testing.fuzz import DEFAULT_SETTINGS, fuzz_controller, fuzz_stack, robot_stack
from humanoid_sim.testing.healthy import ScriptedPolicy, healthy_state, healthy_tick, misbehaviours, well_behaved
from humanoid_sim.testing.machine import StackMachine
from humanoid_sim.testing.properties import SafetyProperties, SafetyViolationError, fingerprint
from humanoid_sim.testing.strategies import (
    any_commands,
    any_remote_commands,
    any_states,
    any_tick_inputs,
    clock_jumps,
    healthy_states,
    intents,
    safety_statuses,
    valid_commands,
)

__all__ = [
    "DEFAULT_SETTINGS",
    "SafetyProperties",
    "SafetyViolationError",
    "ScriptedPolicy",
    "StackMachine",
    "any_commands",
    "any_remote_commands",
    "any_states",
    "any_tick_inputs",
    "clock_jumps",
    "fingerprint",
    "fuzz_controller",
    "fuzz_stack",
    "healthy_state",
    "healthy_states",
    "healthy_tick",
    "intents",
    "misbehaviours",
    "robot_stack",
    "safety_statuses",
    "valid_commands",
    "well_behaved",
]
