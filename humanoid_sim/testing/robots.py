"""The stack of a robot description, with a policy that can be told to misbehave."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.policy.checkpoint import placeholder_checkpoint
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.robots.description import load_robot
from humanoid_sim.stack import build_supervisor
from humanoid_sim.testing.policies import ScriptedPolicy

__all__ = ["robot_stack"]


def robot_stack(name_or_path: str | Path) -> Callable[[ScriptedPolicy], Supervisor]:
    """For `fuzz_stack`: all controllers of a robot, with the settings of its description.

    LOCOMOTION runs the fuzzed policy on all joints, around the final pose of standby A.

    Args:
        name_or_path: a shipped robot, a YAML description, or an MJCF.

    Raises:
        InputError: if there is no such robot, or its description is wrong.
    """
    description = load_robot(name_or_path)
    period = 1.0 / description.hardware.control_frequency
    contract = placeholder_checkpoint(description, policy_dt=period).contract

    def build(policy: ScriptedPolicy) -> Supervisor:
        return build_supervisor(description, period, load_policy(contract, policy, None), remote=True)

    return build
