"""A policy under test, ready to run many episodes at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint
from humanoid_sim.policy.onnx_policy import OnnxPolicy
from humanoid_sim.regress.batched_policy import BatchedPolicy
from humanoid_sim.regress.suite import Suite
from humanoid_sim.robots.description import RobotDescription, load_robot, shipped_robots

__all__ = ["Subject", "load_subject", "robot_name", "suite_robot", "unique_names"]


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """A checkpoint on a robot."""

    name: str
    checkpoint: Checkpoint
    policy: BatchedPolicy
    description: RobotDescription
    """Of the robot, as it is without a policy."""


def robot_name(suite: Suite, folder: Path, robot: str | None) -> str:
    """What the robot is called, wherever one is: a shipped robot's name or an absolute path.

    Raises:
        InputError: there is none.
    """
    name = robot or suite.robot
    if not name:
        raise InputError(f"--robot: is missing; the suite '{suite.name}' is for any robot and names none")
    path = Path(name) if robot else folder / name
    return name if name in shipped_robots() or not path.is_file() else str(path.resolve())


def suite_robot(suite: Suite, folder: Path, robot: str | None) -> RobotDescription:
    """The robot of a suite, or another in its place.

    Raises:
        InputError: neither names one, or it cannot be read.
    """
    description = load_robot(robot_name(suite, folder, robot))
    if suite.task == "velocity" and not description.is_floating:
        raise InputError(f"robot '{description.name}': has a fixed base, a velocity suite expects a floating one")
    if not description.is_floating:
        _refuse_idle_disturbances(suite, description)
    if suite.base_height is not None:
        base = msgspec.structs.replace(description.base, height=suite.base_height)
        description = msgspec.structs.replace(description, base=base)
    return description


def _refuse_idle_disturbances(suite: Suite, description: RobotDescription) -> None:
    """What a robot on a fixed base would not feel, and would be praised for bearing."""
    where = f"robot '{description.name}': has a fixed base"
    if suite.pushes is not None:
        raise InputError(f"{where}, which the suite's pushes would not move")
    for sweep in () if suite.margins is None else suite.margins.sweeps:
        if sweep.axis in ("push", "friction"):
            raise InputError(f"{where}, which does not feel the suite's sweep of {sweep.axis}")


def load_subject(path: Path, contract_file: Path | None, description: RobotDescription, suite: Suite) -> Subject:
    """Load a checkpoint and see whether it is one for the suite's task.

    Raises:
        InputError: one line that names the file and what is wrong.
    """
    checkpoint = load_checkpoint(path, contract_file, description.joint_names)
    walks = checkpoint.contract.task_type == "locomotion"
    if walks is (suite.task == "tracking") or checkpoint.contract.task_type == "piano":
        raise InputError(
            f"{path}: is a policy for task_type {checkpoint.contract.task_type}, the suite '{suite.name}' is for "
            f"{'a policy that follows motions' if suite.task == 'tracking' else 'one that walks at a velocity'}"
        )
    assert isinstance(checkpoint.policy, OnnxPolicy)  # load_checkpoint makes no other
    return Subject(path.stem, checkpoint, BatchedPolicy(checkpoint.policy), description)


def unique_names(subjects: Sequence[Subject]) -> list[Subject]:
    """The subjects, with names that tell them apart: the file's, and its folder's where that is not enough."""
    names = [subject.name for subject in subjects]
    if len(set(names)) < len(names):
        paths = [Path(subject.checkpoint.source).resolve() for subject in subjects]
        names = [f"{path.parent.name}/{path.stem}" for path in paths]
    for i, name in enumerate(names):
        count = names[:i].count(name)
        if count:
            names[i] = f"{name} ({count + 1})"
    return [replace(subject, name=name) for subject, name in zip(subjects, names, strict=True)]
