"""The thirteen keys of a self-describing checkpoint."""

from __future__ import annotations

from collections.abc import Mapping

from humanoid_sim.policy.readers import csv_values
from humanoid_sim.policy.readers.partial import Given, PartialContract

__all__ = ["METADATA_KEYS", "OWN_SOURCE", "is_own", "read_own"]

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
            fields[key] = Given(csv_values.number(key, text, where), OWN_SOURCE)
        elif key == "lookahead_steps":
            fields[key] = Given(csv_values.integers(key, text, where), OWN_SOURCE)
        elif key.endswith("_names"):
            field = "observation" if key == "observation_names" else key
            fields[field] = Given(csv_values.names(text), OWN_SOURCE)
        else:
            fields[key] = csv_values.numbers(key, text, where, OWN_SOURCE)
    return PartialContract(OWN_SOURCE, fields)
