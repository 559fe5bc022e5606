"""What a user of an environment names or gives: a policy and its motion, a velocity command."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from humanoid_sim.assets import asset_path, motion_path
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint, zero_policy
from humanoid_sim.policy.loaded_policy import LoadedPolicy, load_policy
from humanoid_sim.policy.motion import Motion, read_motion
from humanoid_sim.policy.readers.contract_yaml import read_contract_file
from humanoid_sim.policy.readers.merge import merge

__all__ = ["Named", "read_policy", "velocity_option"]

Named = str | Path
"""The name of a file that ships with the package, or a path."""

_CONTRACTS = (".yaml", ".yml")


def read_policy(source: Named | PolicyContract, motion: Named | Motion | None, joints: tuple[str, ...]) -> LoadedPolicy:
    """A policy with the motion that it follows, checked against each other.

    Args:
        source: a contract, or the name or path of a checkpoint or a contract file. Where there is no checkpoint the
            policy answers zeros.
        motion: a sample motion by name, a file by path, or the motion itself; None for the one that a checkpoint
            carries in its graph, and for policies that follow none.
        joints: of the robot, in its order.

    Raises:
        InputError: one line that says what cannot be read, or what does not fit.
    """
    checkpoint = _checkpoint(source, joints)
    contract, followed = checkpoint.contract, checkpoint.motion
    what = "motion" if isinstance(motion, Motion | None) else str(motion)
    if motion is not None:
        followed = motion if isinstance(motion, Motion) else _read_motion(what)
    if contract.task_type == "locomotion":
        if motion is not None:
            raise InputError(f"motion: is '{what}', but {checkpoint.source} follows no motion")
    elif followed is None:
        raise InputError(f"motion: is missing; {checkpoint.source} is a {contract.task_type} policy and follows one")
    return load_policy(
        contract,
        checkpoint.policy,
        followed,
        checkpoint.observation_width,
        source=checkpoint.source,
        motion_source=what,
    )


def velocity_option(value: Any) -> FloatArray:
    """Shape (3,): vx, vy in m/s and yaw rate in rad/s.

    Raises:
        InputError: the option is not three finite numbers.
    """
    try:
        command = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        command = np.empty(0)
    if command.shape != (3,) or not np.isfinite(command).all():
        raise InputError(f"reset: command is {value!r}, expected vx, vy and yaw rate: three finite numbers")
    return command


def _checkpoint(source: Named | PolicyContract, joints: tuple[str, ...]) -> Checkpoint:
    if isinstance(source, PolicyContract):
        return Checkpoint(source, zero_policy(source.action_count), "contract")
    path = _policy_file(source)
    if path.suffix == ".onnx":
        return load_checkpoint(path, None, joints)
    contract = merge(read_contract_file(path), str(path), joints)
    return Checkpoint(contract, zero_policy(contract.action_count), str(path))


def _read_motion(name: str) -> Motion:
    try:
        path = motion_path(name)
    except InputError as error:  # which names the option of `play`
        raise InputError(str(error).removeprefix("--")) from None
    return read_motion(path)


def _policy_file(name: Named) -> Path:
    """The file of a checkpoint (.onnx) or a contract (.yaml)."""
    shipped = {path.name.split(".")[0]: path for path in sorted(asset_path("policies").iterdir())}
    path = shipped.get(str(name), Path(name))
    if path.suffix not in (".onnx", *_CONTRACTS):
        known = ", ".join(shipped)
        raise InputError(f"policy: is '{name}', expected a checkpoint (.onnx), a contract (.yaml) or one of: {known}")
    return path
