"""Fuzz your own controllers, robot settings and control stacks with Hypothesis (extra `testing`).

    from humanoid_sim.testing import fuzz_controller, fuzz_stack, robot_stack

    def test_my_robot():
        fuzz_stack(robot_stack("my_robot.yaml"))

    def test_my_controller():
        fuzz_controller(MyController(JOINTS))

A failure is a `SafetyViolationError`, printed with the shortest run that Hypothesis found to lead to it. `StackMachine`
is the same as a class, for rules and properties of one's own. `docs/testing.md` says what is checked.
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
from humanoid_sim.testing.healthy import (
    ScriptedPolicy,
    healthy_externs,
    healthy_state,
    healthy_tick,
    misbehaviours,
    well_behaved,
)
from humanoid_sim.testing.machine import StackMachine
from humanoid_sim.testing.properties import SafetyProperties, SafetyViolationError, fingerprint
from humanoid_sim.testing.strategies import (
    any_arrays,
    any_commands,
    any_externs,
    any_numbers,
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
    "any_arrays",
    "any_commands",
    "any_externs",
    "any_numbers",
    "any_remote_commands",
    "any_states",
    "any_tick_inputs",
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
    "robot_stack",
    "safety_statuses",
    "valid_commands",
    "well_behaved",
]
