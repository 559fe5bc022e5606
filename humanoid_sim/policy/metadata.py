"""The thirteen metadata keys of a self-describing checkpoint, to and from a `PolicyContract`.

Lists are CSV strings, the way mjlab's exporter writes them. Numbers are written with all their digits: three decimals,
as that exporter rounds to, shift gains and poses.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from humanoid_sim.controllers.contract import FORMS, PolicyContract
from humanoid_sim.errors import FieldError
from humanoid_sim.policy.readers.partial import PartialContract
from humanoid_sim.policy.readers.values import csv_field

OWN_SOURCE = "metadata"
_FIELDS = {name.replace("observation", "observation_names"): name for name, form in FORMS.items() if form.in_metadata}
"""Key to field of the contract."""
METADATA_KEYS = tuple(_FIELDS)
_ONLY_HERE = ("task_type", "action_joint_names", "policy_dt", "dataset_repo_id", "lookahead_steps")


def is_own(metadata: Mapping[str, str]) -> bool:
    """Return whether the metadata has any key that only this dialect has."""
    return any(key in metadata for key in _ONLY_HERE)


def read_own(metadata: Mapping[str, str], where: str) -> PartialContract:
    """Return the keys that are there; other keys are not of the contract and are left alone."""
    known = {key: field for key, field in _FIELDS.items() if key in metadata}
    fields = {field: csv_field(field, key, metadata[key], where, OWN_SOURCE) for key, field in known.items()}
    return PartialContract(OWN_SOURCE, fields)


def write_metadata(contract: PolicyContract) -> dict[str, str]:
    """Return the thirteen keys of a contract; `read_own` gives what they can say of it back, bit for bit.

    Raises `FieldError` if a name holds a comma or has spaces around it, which a CSV list cannot keep.
    """
    # Keys differ from the fields' names in one, `observation_names`, and that is a property of the contract.
    return {key: _csv(key, getattr(contract, key)) for key in METADATA_KEYS}


def _csv(key: str, value: Any) -> str:
    if isinstance(value, str):
        return value.strip()
    items = [value] if isinstance(value, float) else list(value)
    for name in items:
        if isinstance(name, str) and ("," in name or name != name.strip()):
            raise FieldError(f"PolicyContract.{key}: {name!r} has a comma or outer spaces, which CSV cannot keep")
    return ",".join(repr(float(item)) if isinstance(item, float) else str(item) for item in items)
