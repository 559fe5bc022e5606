"""Metadata of models from holosoma: JSON, and only the part that a robot needs to stand."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.policy.readers.partial import Given, PartialContract, assumed
from humanoid_sim.policy.readers.values import cut, numbers, pair_of_numbers, plain_numbers

HOLOSOMA_SOURCE = "holosoma metadata"

_COMMANDS = ("lin_vel_x", "lin_vel_y", "ang_vel_yaw")


def is_holosoma(metadata: Mapping[str, str]) -> bool:
    """Return whether the metadata has the key by which this dialect is known."""
    return "dof_names" in metadata


def read_holosoma(metadata: Mapping[str, str], where: str) -> PartialContract:
    """Joints, gains and command ranges, of trackers the action scale.

    The rest is in the trainer's Python configuration, and for a contract.yaml.
    """
    fields: dict[str, Given] = {}
    names = _parse("dof_names", metadata, where)
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise _wrong(where, "dof_names", metadata, "a JSON list of names")
    fields["joint_names"] = Given(tuple(names), HOLOSOMA_SOURCE)
    for key, field in (("kp", "joint_stiffness"), ("kd", "joint_damping")):
        if key in metadata:
            fields[field] = Given(_numbers(key, metadata, where), HOLOSOMA_SOURCE)
    if "action_scale" in metadata:
        text = metadata["action_scale"].strip().strip('"')
        if text.startswith("["):  # JSON, as the rest
            fields["action_scale"] = Given(_numbers("action_scale", metadata, where), HOLOSOMA_SOURCE)
        else:
            fields["action_scale"] = numbers("action_scale", text, where, HOLOSOMA_SOURCE)
    ranges = _parse("command_ranges", metadata, where) if "command_ranges" in metadata else None
    if ranges is not None:
        pairs = [pair_of_numbers(ranges.get(name)) for name in _COMMANDS] if isinstance(ranges, dict) else [None]
        if None in pairs:
            expected = f"a JSON object with [least, greatest] for {', '.join(_COMMANDS)}"
            raise _wrong(where, "command_ranges", metadata, expected)
        fields["command_ranges"] = Given(np.array(pairs, dtype=np.float64), HOLOSOMA_SOURCE)
    return PartialContract(HOLOSOMA_SOURCE, fields, assumed=assumed("holosoma", {"policy_dt": 0.02}))


def _parse(key: str, metadata: Mapping[str, str], where: str) -> Any:
    try:
        return json.loads(metadata[key])
    except ValueError:
        raise _wrong(where, key, metadata, "JSON") from None


def _numbers(key: str, metadata: Mapping[str, str], where: str) -> Any:
    found = plain_numbers(_parse(key, metadata, where))
    if found is None:
        raise _wrong(where, key, metadata, "a JSON list of numbers")
    return found


def _wrong(where: str, key: str, metadata: Mapping[str, str], expected: str) -> InputError:
    return InputError(f"{where}: {key} is {cut(metadata[key])!r}, expected {expected}")
