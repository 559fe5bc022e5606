"""What mjlab and whole_body_tracking write into the metadata of a model: comma-separated lists, three decimals."""

from __future__ import annotations

from collections.abc import Mapping

from humanoid_sim.policy.readers import csv_values
from humanoid_sim.policy.readers.partial import Given, PartialContract, given

__all__ = ["MJLAB_SOURCE", "is_mjlab", "read_mjlab"]

MJLAB_SOURCE = "mjlab metadata"
_ASSUMED = "assumed (mjlab)"

_FIELDS = {
    "joint_names": "joint_names",
    "observation_names": "observation",
    "command_names": "command_names",
    "body_names": "body_names",
}
_NUMBERS = ("joint_stiffness", "joint_damping", "default_joint_pos", "action_scale")


def is_mjlab(metadata: Mapping[str, str]) -> bool:
    """Whether the metadata has the keys by which this dialect is known."""
    return "joint_names" in metadata and ("joint_stiffness" in metadata or "observation_names" in metadata)


def read_mjlab(metadata: Mapping[str, str], where: str) -> PartialContract:
    """The keys that are there. The rate, and how the terms are scaled and stacked, are not: mjlab's usual is assumed.

    Raises:
        InputError: naming `where`, the key and its text, if one is malformed.
    """
    fields: dict[str, Given] = {}
    for key, field in _FIELDS.items():
        if key in metadata:
            fields[field] = Given(csv_values.names(metadata[key]), MJLAB_SOURCE)
    for key in _NUMBERS:
        if key in metadata:
            fields[key] = csv_values.numbers(key, metadata[key], where, MJLAB_SOURCE)
    if "anchor_body_name" in metadata:
        fields["anchor_body"] = Given(metadata["anchor_body_name"].strip(), MJLAB_SOURCE)
    return PartialContract(
        MJLAB_SOURCE,
        fields,
        assumed=given(_ASSUMED, {"policy_dt": 0.02, "reference_quaternion": "wxyz"}),
        assumed_terms=given(_ASSUMED, {"scale": 1.0, "history": 1}),
    )
