"""Tasks for a policy, for one robot or a batch of them: where it starts, its reward, and when it has failed.

Single, vector and `dm_env` environments, training and regression all judge a policy step with the functions of this
package. Everything takes and returns arrays `(..., n)`; nothing simulates and nothing is random but the numbers that a
caller hands in.

A new task is a class in a file of its own, and an entry in `TASKS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.envs.tasks.piano import PianoTask
from humanoid_sim.envs.tasks.task import BalanceTask, Task
from humanoid_sim.envs.tasks.tracking import MotionTask, TrackingTask
from humanoid_sim.envs.tasks.velocity import VelocityTask, WalkingTask
from humanoid_sim.errors import InputError, require_known
from humanoid_sim.robots.schema import RobotDescription

__all__ = ["TASKS", "TASK_OPTIONS", "Task", "make_task"]

TASKS: Mapping[str, type[Task]] = MappingProxyType(
    {
        "tracking": TrackingTask,
        "motion": MotionTask,
        "piano": PianoTask,
        "velocity": VelocityTask,
        "walking": WalkingTask,
        "balance": BalanceTask,
    }
)
"""By name."""
TASK_OPTIONS = ("weights", "episode_seconds", "joint_noise", "velocity_noise", "rewards")
"""Options of any task; the rest comes from the robot."""


def make_task(
    task: str | type[Task],
    description: RobotDescription,
    contract: PolicyContract,
    reference: MotionReference,
    **options: Any,
) -> Task:
    """Return a task; `auto`: the one that the contract and its motion were made for.

    Raises `InputError` if there is no such task, or it is not one for this robot and motion.

    Args:
        task: name in `TASKS`, or `auto`; or a class of your own.
        options: as `Task` takes them.
    """
    if not isinstance(task, str):
        return task(description, contract, reference, **options)
    name = task
    if name == "auto":
        walks = description.is_floating and contract.task_type == "locomotion"
        followed = (name for name, kind in TASKS.items() if kind.REFERENCE in reference.terms)
        name = next(followed, "velocity" if walks else "balance")
    require_known("task", [name], ("auto", *TASKS), "task: ")
    kind = TASKS[name]
    if kind.REFERENCE and kind.REFERENCE not in reference.terms:
        raise InputError(f"task: {name} needs a motion with {kind.REFERENCE}, and the policy's has none")
    return kind(description, contract, reference, **options)
