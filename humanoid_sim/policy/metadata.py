"""The thirteen metadata keys of a self-describing checkpoint, to and from a `PolicyContract`.

Lists are CSV strings, the way mjlab's exporter writes them. Numbers are written with all their digits: three decimals,
as that exporter rounds to, shift gains and poses.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import get_args

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract, TaskType
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.mit import FloatArray

__all__ = ["METADATA_KEYS", "parse_metadata", "write_metadata"]

METADATA_KEYS = (
    "task_type",
    "joint_names",
    "action_joint_names",
    "joint_stiffness",
    "joint_damping",
    "default_joint_pos",
    "observation_names",
    "command_names",
    "action_scale",
    "policy_dt",
    "body_names",
    "dataset_repo_id",
    "lookahead_steps",
)

_NAME_LISTS = ("joint_names", "action_joint_names", "observation_names", "command_names", "body_names")


def parse_metadata(metadata: Mapping[str, str], source: str) -> PolicyContract:
    """The contract in a checkpoint's `custom_metadata_map`.

    Args:
        metadata: key to text; keys that are not of the contract are ignored.
        source: what to call the checkpoint in messages.

    Raises:
        InputError: naming every missing key, or the first malformed or inconsistent one.
    """
    missing = [key for key in METADATA_KEYS if key not in metadata]
    if missing:
        present = ", ".join(sorted(metadata)) or "none"
        raise InputError(f"{source}: metadata lacks {', '.join(missing)}; present: {present}")
    task_type = metadata["task_type"].strip()
    for known in get_args(TaskType):
        if task_type == known:
            break
    else:
        raise InputError(f"{source}: task_type is {task_type!r}, expected one of {', '.join(get_args(TaskType))}")
    try:
        return PolicyContract(
            task_type=known,
            joint_names=_names(metadata, "joint_names"),
            action_joint_names=_names(metadata, "action_joint_names"),
            joint_stiffness=_numbers(metadata, "joint_stiffness", source),
            joint_damping=_numbers(metadata, "joint_damping", source),
            default_joint_pos=_numbers(metadata, "default_joint_pos", source),
            observation=_names(metadata, "observation_names"),
            command_names=_names(metadata, "command_names"),
            action_scale=_numbers(metadata, "action_scale", source),
            policy_dt=_number(metadata, "policy_dt", source),
            body_names=_names(metadata, "body_names"),
            dataset_repo_id=metadata["dataset_repo_id"].strip(),
            lookahead_steps=_integers(metadata, "lookahead_steps", source),
        )
    except FieldError as error:
        raise InputError(f"{source}: {str(error).removeprefix('PolicyContract.')}") from None


def write_metadata(contract: PolicyContract) -> dict[str, str]:
    """The thirteen keys of a contract; `parse_metadata` gives the same contract back, bit for bit.

    Raises:
        FieldError: if a name holds a comma or has spaces around it, which a CSV list cannot keep.
    """
    for key in _NAME_LISTS:
        for name in getattr(contract, key):
            if "," in name or name != name.strip():
                raise FieldError(f"PolicyContract.{key}: {name!r} has a comma or outer spaces, which CSV cannot keep")
    return {
        "task_type": contract.task_type,
        "joint_names": ",".join(contract.joint_names),
        "action_joint_names": ",".join(contract.action_joint_names),
        "joint_stiffness": _csv(contract.joint_stiffness),
        "joint_damping": _csv(contract.joint_damping),
        "default_joint_pos": _csv(contract.default_joint_pos),
        "observation_names": ",".join(contract.observation_names),
        "command_names": ",".join(contract.command_names),
        "action_scale": _csv(contract.action_scale),
        "policy_dt": repr(contract.policy_dt),
        "body_names": ",".join(contract.body_names),
        "dataset_repo_id": contract.dataset_repo_id.strip(),
        "lookahead_steps": ",".join(str(step) for step in contract.lookahead_steps),
    }


def _csv(values: FloatArray) -> str:
    return ",".join(repr(float(value)) for value in values)


def _items(metadata: Mapping[str, str], key: str) -> list[str]:
    text = metadata[key].strip()
    return [item.strip() for item in text.split(",")] if text else []


def _names(metadata: Mapping[str, str], key: str) -> tuple[str, ...]:
    return tuple(_items(metadata, key))


def _number(metadata: Mapping[str, str], key: str, source: str) -> float:
    try:
        return float(metadata[key])
    except ValueError:
        raise InputError(f"{source}: {key} is {metadata[key]!r}, expected one number") from None


def _numbers(metadata: Mapping[str, str], key: str, source: str) -> FloatArray:
    """The numbers of a key; a single one where a list is expected stands for every joint."""
    try:
        values = [float(item) for item in _items(metadata, key)]
    except ValueError:
        raise InputError(f"{source}: {key} is {metadata[key]!r}, expected numbers separated by commas") from None
    if not values:
        raise InputError(f"{source}: {key} is empty, expected numbers separated by commas")
    return np.array(values[0] if len(values) == 1 else values)


def _integers(metadata: Mapping[str, str], key: str, source: str) -> tuple[int, ...]:
    try:
        return tuple(int(item) for item in _items(metadata, key))
    except ValueError:
        raise InputError(f"{source}: {key} is {metadata[key]!r}, expected integers separated by commas") from None
