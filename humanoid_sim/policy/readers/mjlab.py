"""Metadata of models from mjlab and whole_body_tracking: comma-separated lists, three decimals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import HeightScan
from humanoid_sim.controllers.terms import term_kind
from humanoid_sim.errors import InputError
from humanoid_sim.mit import HEIGHT_SCAN, IMU
from humanoid_sim.names import near_miss
from humanoid_sim.policy.layers import Layer
from humanoid_sim.policy.readers.own import GOLDEN_KEY, csv, csv_field, csv_numbers

_SOURCE = "mjlab metadata"
_FIELDS = {
    **{name: name for name in ("joint_names", "command_names", "body_names", "joint_stiffness", "joint_damping")},
    **{"default_joint_pos": "default_joint_pos", "action_scale": "action_scale"},
    **{"observation_names": "observation", "anchor_body_name": "anchor_body"},
}
"""Key of the metadata to field of the contract."""
_SCALE, _CLIP = "observation_terms_scale", "observation_terms_clip"
_HISTORY, _FLATTEN = "observation_terms_history_length", "observation_terms_flatten_history_dim"
_TERM_KEYS = (_SCALE, _CLIP, _HISTORY, _FLATTEN)
_WITHOUT_EFFECT = ("run_path", GOLDEN_KEY)

GAIT_CLOCK: Mapping[str, Any] = MappingProxyType(
    {
        "phase.offsets": [0.0],
        "phase.standing_threshold": 0.1,
        "phase.standing_value": None,
        "phase.standing_restarts": False,
    }
)
"""The clock that mjlab's term `phase` implies, and Unitree's deployment of it: one clock, which runs on while the robot
stands; while |(vx, vy, yaw rate)| is below the threshold sine and cosine are both 0."""


def is_mjlab(metadata: Mapping[str, str]) -> bool:
    """Return whether the metadata has the keys by which this dialect is known."""
    return "joint_names" in metadata and ("joint_stiffness" in metadata or "observation_names" in metadata)


def read_mjlab(metadata: Mapping[str, str], where: str) -> list[Layer]:
    """Return the keys that are there, and what mjlab implies.

    The rate is not written, and before mjlab 1.6 neither is how terms are scaled, clipped and stacked. The velocity of
    the base is that of the IMU where mjlab 1.6 or later has written the file: its tasks observe the velocimeter there.
    Files without its keys may be whole_body_tracking's, which observes the base itself.
    """
    values = {name: csv_field(name, key, metadata[key], where) for key, name in _FIELDS.items() if key in metadata}
    names: Sequence[str] = values.get("observation", ())
    kinds = {name: term_kind(name).name for name in names}
    assumed: dict[str, Any] = {"policy_dt": 0.02, "reference_quaternion": "wxyz"}
    for name in names:
        assumed |= {f"observation.{name}.scale": 1.0, f"observation.{name}.history": 1}
        if kinds[name] == HEIGHT_SCAN:
            assumed[f"observation.{name}.scan"] = HeightScan()
        elif kinds[name] == "base_lin_vel" and _SCALE in metadata:
            assumed[f"observation.{name}.at"] = IMU
        elif term_kind(name).requires == "phase":  # in training, the first observation shows the clock as it starts
            assumed |= {**GAIT_CLOCK, "phase.advance_first": False}
    values |= _terms(metadata, names, where)
    known = (*_FIELDS, *_TERM_KEYS, *_WITHOUT_EFFECT)
    unused = tuple(_unknown(key) for key in metadata if key not in known)
    return [Layer("assumed (mjlab)", assumed, is_assumed=True), Layer(_SOURCE, values, unused=unused)]


def _unknown(key: str) -> str:
    near = near_miss(key, (*_FIELDS, *_TERM_KEYS))
    return f"metadata key '{key}' is not read" + (f"; mjlab's is '{near}'" if near else "")


def _terms(metadata: Mapping[str, str], names: Sequence[str], where: str) -> dict[str, Any]:
    """Return the options of each term that mjlab 1.6 writes, one entry per term."""
    values: dict[str, Any] = {}
    for key in _TERM_KEYS:
        if key not in metadata:
            continue
        rows = _rows(key, metadata[key], where)
        if len(rows) != len(names):
            raise InputError(f"{where}: {key} has {len(rows)} entries, expected {len(names)}, one for each term")
        for name, row in zip(names, rows, strict=True):
            field = f"observation.{name}"
            if key == _SCALE:
                values[f"{field}.scale"] = row[0] if len(row) == 1 else row
            elif key == _CLIP and len(row) == 2 and row != [-np.inf, np.inf]:
                values[f"{field}.clip"] = row
            elif key == _HISTORY:  # 0 stands for a term without a history: it shows the present step alone
                values[f"{field}.history"] = max(int(row[0]), 1)
            elif key == _FLATTEN and not row[0] and values.get(f"{field}.history", 1) > 1:
                expected = "expected True: the observation has to be flat"
                raise InputError(f"{where}: {_FLATTEN} is False for {name}, {expected}")
    return values


def _rows(key: str, text: str, where: str) -> list[list[float]]:
    """Return the numbers of each term: commas between terms, semicolons within one."""
    words = {"True": "1", "False": "0"}
    return [csv_numbers(key, words.get(item, item).replace(";", ","), where) for item in csv(text)]
