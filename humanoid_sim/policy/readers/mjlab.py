"""Metadata as comma-separated lists: the thirteen keys, or those of mjlab and whole_body_tracking, three decimals."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import HeightScan
from humanoid_sim.controllers.terms import term_kind
from humanoid_sim.errors import InputError
from humanoid_sim.mit import HEIGHT_SCAN, IMU
from humanoid_sim.policy.layers import Layer
from humanoid_sim.policy.readers.own import GOLDEN_KEY, METADATA_KEYS, csv, csv_field, csv_numbers, unread_keys

_FIELDS = {key: key.replace("observation_names", "observation") for key in METADATA_KEYS}
_FIELDS["anchor_body_name"] = "anchor_body"
"""Key of the metadata to field of the contract."""
_OWN = {"task_type", "action_joint_names", "policy_dt", "dataset_repo_id", "lookahead_steps"}
"""Those of the thirteen keys that mjlab does not write."""
_SCALE, _CLIP = "observation_terms_scale", "observation_terms_clip"
_HISTORY = "observation_terms_history_length"
_OF_TERMS = (_SCALE, _CLIP, _HISTORY)
_READ = (*_FIELDS, *_OF_TERMS, "observation_terms_flatten_history_dim")  # flat, or the model's input would not be

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


def read_csv(metadata: Mapping[str, str], where: str) -> list[Layer]:
    """Return the keys that are there, and what mjlab implies: the rate, and before mjlab 1.6 the options of terms."""
    is_own = bool(_OWN & metadata.keys())
    if not is_own and ("joint_names" not in metadata or not {"joint_stiffness", "observation_names"} & metadata.keys()):
        return []
    values = {name: csv_field(key, metadata[key], where) for key, name in _FIELDS.items() if key in metadata}
    if is_own:
        return [Layer("metadata", values)]
    names = values.get("observation", ())
    rows = {key: _rows(key, metadata[key], len(names), where) for key in _OF_TERMS if key in metadata}
    assumed: dict[str, Any] = {"policy_dt": 0.02}
    for i, name in enumerate(names):
        kind, field = term_kind(name), f"observation.{name}"
        own = {key: table[i] for key, table in rows.items()}
        assumed |= {f"{field}.scale": 1.0, f"{field}.history": 1}
        if kind.task == "tracking":
            assumed["reference_quaternion"] = "wxyz"
        if kind.name == HEIGHT_SCAN:
            assumed[f"{field}.scan"] = HeightScan()
        elif kind.name == "base_lin_vel" and _SCALE in metadata:
            # mjlab 1.6 observes the velocimeter there, whole_body_tracking the base itself.
            assumed[f"{field}.at"] = IMU
        elif kind.requires == "phase":  # in training, the first observation shows the clock as it starts
            assumed |= {**GAIT_CLOCK, "phase.advance_first": False}
        if _SCALE in own:
            values[f"{field}.scale"] = own[_SCALE] if len(own[_SCALE]) > 1 else own[_SCALE][0]
        if own.get(_CLIP, [-np.inf, np.inf]) != [-np.inf, np.inf]:
            values[f"{field}.clip"] = own[_CLIP]
        if _HISTORY in own:  # 0 stands for a term without a history: it shows the present step alone
            values[f"{field}.history"] = max(int(own[_HISTORY][0]), 1)
    unused = unread_keys(metadata, (*_READ, "run_path", GOLDEN_KEY))
    return [Layer("assumed (mjlab)", assumed), Layer("mjlab metadata", values, unused=unused)]


def _rows(key: str, text: str, count: int, where: str) -> list[list[float]]:
    rows = [csv_numbers(key, item.replace(";", ","), where) for item in csv(text)]
    if len(rows) != count:
        raise InputError(f"{where}: {key} has {len(rows)} entries, expected {count}, one for each term")
    return rows
