"""Fuzz your own controllers, robot settings and control stacks with Hypothesis (extra `testing`).

A robot's settings, by its name or YAML file:

    from humanoid_sim.testing import fuzz_stack, robot_stack

    def test_my_robot():
        fuzz_stack(robot_stack("my_robot.yaml"))

A controller by itself, or a whole stack that it is part of:

    from humanoid_sim.testing import fuzz_controller, fuzz_stack

    def test_my_controller():
        fuzz_controller(MyController(JOINTS))

    def test_my_stack():
        fuzz_stack(lambda policy: my_supervisor(policy))

A failure is a `SafetyViolationError`, printed with the shortest run that Hypothesis found to lead to it. `StackMachine`
is the same as a class, for rules and properties of one's own; the strategies may be used by themselves.
`docs/testing.md` shows both, and says what is checked.
"""

import sys

try:
    import hypothesis as _hypothesis  # noqa: F401
except ImportError:
    from humanoid_sim.errors import MissingPackageError

    _missing = MissingPackageError("hypothesis", "testing", "humanoid_sim.testing")
    if sys.argv[:1] == ["-m"]:  # what Python has there while `python -m humanoid_sim.testing` looks for the program
        print(f"error: {_missing}", file=sys.stderr)
        sys.exit(2)
    raise _missing from None

from humanoid_sim.testing.fuzz import DEFAULT_SETTINGS, fuzz_controller, fuzz_stack, robot_stack
from humanoid_sim.testing.healthy import healthy_externs, healthy_state, healthy_tick
from humanoid_sim.testing.machine import StackMachine
from humanoid_sim.testing.policies import (
    Misbehaviour,
    ScriptedPolicy,
    misbehaviours,
    policies_that_misbehave,
    well_behaved,
)
from humanoid_sim.testing.properties import SafetyProperties, SafetyViolationError, fingerprint
from humanoid_sim.testing.strategies import (
    SPECIAL_NUMBERS,
    any_arrays,
    any_commands,
    any_externs,
    any_numbers,
    any_remote_commands,
    any_states,
    any_tick_inputs,
    button_readings,
    clock_jumps,
    healthy_states,
    intents,
    moderate_numbers,
    safety_statuses,
    valid_commands,
)

__all__ = [
    "DEFAULT_SETTINGS",
    "SPECIAL_NUMBERS",
    "Misbehaviour",
    "SafetyProperties",
    "SafetyViolationError",
    "ScriptedPolicy",
    "StackMachine",
    "any_arrays",
    "any_commands",
    "any_externs",
    "any_numbers",
    "any_remote_commands",
    "any_states",
    "any_tick_inputs",
    "button_readings",
    "clock_jumps",
    "fingerprint",
    "fuzz_controller",
    "fuzz_stack",
    "healthy_externs",
    "healthy_state",
    "healthy_states",
    "healthy_tick",
    "intents",
    "misbehaviours",
    "moderate_numbers",
    "policies_that_misbehave",
    "robot_stack",
    "safety_statuses",
    "valid_commands",
    "well_behaved",
]
