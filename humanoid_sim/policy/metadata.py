"""The thirteen metadata keys of a self-describing checkpoint, to and from a `PolicyContract`.

Lists are CSV strings, the way mjlab's exporter writes them. Numbers are written with all their digits: three decimals,
as that exporter rounds to, shift gains and poses.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import get_args

from humanoid_sim.controllers.contract import PolicyContract, TaskType
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.readers import text_values
from humanoid_sim.policy.readers.partial import Given, PartialContract
from humanoid_sim.policy.readers.text_values import one_line

__all__ = ["METADATA_KEYS", "OWN_SOURCE", "is_own", "parse_metadata", "read_own", "write_metadata"]


_NAME_LISTS = ("joint_names", "action_joint_names", "observation_names", "command_names", "body_names")


def parse_metadata(metadata: Mapping[str, str], source: str) -> PolicyContract:
    """The contract in a checkpoint's `custom_metadata_map`, which has to hold all thirteen keys.

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
    if task_type not in get_args(TaskType):
        raise InputError(f"{source}: task_type is {task_type!r}, expected one of {', '.join(get_args(TaskType))}")
    partial = read_own(metadata, source)
    values = {name: given.value for name, given in partial.fields.items()}
    provenance = {name: given.source for name, given in partial.fields.items()}
    try:
        return PolicyContract(**values, provenance=provenance)
    except FieldError as error:
        problem = str(error).removeprefix("PolicyContract.").replace("observation:", "observation_names:", 1)
        raise InputError(f"{source}: {one_line(problem)}") from None


def write_metadata(contract: PolicyContract) -> dict[str, str]:
    """The thirteen keys of a contract; `parse_metadata` gives what they can say of it back, bit for bit.

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
OWN_SOURCE = "metadata"
_ONLY_HERE = ("task_type", "action_joint_names", "policy_dt", "dataset_repo_id", "lookahead_steps")


def is_own(metadata: Mapping[str, str]) -> bool:
    """Whether the metadata has any key that only this dialect has."""
    return any(key in metadata for key in _ONLY_HERE)


def read_own(metadata: Mapping[str, str], where: str) -> PartialContract:
    """The keys that are there; other keys are not of the contract and are left alone.

    Raises:
        InputError: naming `where`, the key and its text, if one is malformed.
    """
    fields: dict[str, Given] = {}
    for key in METADATA_KEYS:
        if key not in metadata:
            continue
        text = metadata[key]
        if key in ("task_type", "dataset_repo_id"):
            fields[key] = Given(text.strip(), OWN_SOURCE)
        elif key == "policy_dt":
            fields[key] = Given(text_values.number(key, text, where), OWN_SOURCE)
        elif key == "lookahead_steps":
            fields[key] = Given(text_values.integers(key, text, where), OWN_SOURCE)
        elif key.endswith("_names"):
            field = "observation" if key == "observation_names" else key
            fields[field] = Given(text_values.names(text), OWN_SOURCE)
        else:
            fields[key] = text_values.numbers(key, text, where, OWN_SOURCE)
    return PartialContract(OWN_SOURCE, fields)
