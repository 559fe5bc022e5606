"""Fuzz your own controllers, robot settings and control stacks with Hypothesis (extra `testing`); see docs/testing.md.

`fuzz_stack` and `fuzz_controller` are one call each. `StackMachine` is the same as a class, for rules and properties of
one's own. The strategies and `healthy_tick` serve other tests too.
"""

from humanoid_sim.errors import needing

with needing("hypothesis", "testing", "humanoid_sim.testing"):
    import hypothesis as _hypothesis  # noqa: F401

from humanoid_sim.testing.fuzz import DEFAULT_SETTINGS, fuzz_controller, fuzz_stack, robot_stack
from humanoid_sim.testing.healthy import ScriptedPolicy, healthy_state, healthy_tick, misbehaviours
from humanoid_sim.testing.machine import StackMachine
from humanoid_sim.testing.properties import SafetyProperties, SafetyViolationError, fingerprint
from humanoid_sim.testing.strategies import any_commands, any_states, any_tick_inputs, clock_jumps, valid_commands

__all__ = [
    "DEFAULT_SETTINGS",
    "SafetyProperties",
    "SafetyViolationError",
    "ScriptedPolicy",
    "StackMachine",
    "any_commands",
    "any_states",
    "any_tick_inputs",
    "clock_jumps",
    "fingerprint",
    "fuzz_controller",
    "fuzz_stack",
    "healthy_state",
    "healthy_tick",
    "misbehaviours",
    "robot_stack",
    "valid_commands",
]
