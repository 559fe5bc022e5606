"""Metadata of models from mjlab and whole_body_tracking: comma-separated lists, three decimals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from humanoid_sim.controllers.term_kinds import term_kind
from humanoid_sim.errors import InputError
from humanoid_sim.mit import BASE, HEIGHT_SCAN, IMU
from humanoid_sim.policy.readers import values
from humanoid_sim.policy.readers.partial import Given, PartialContract, assumed, given

MJLAB_SOURCE = "mjlab metadata"

_FIELDS = {
    "joint_names": "joint_names",
    "observation_names": "observation",
    "command_names": "command_names",
    "body_names": "body_names",
    "joint_stiffness": "joint_stiffness",
    "joint_damping": "joint_damping",
    "default_joint_pos": "default_joint_pos",
    "action_scale": "action_scale",
    "anchor_body_name": "anchor_body",
}
"""Key of the metadata to field of the contract."""
GAIT_CLOCK: Mapping[str, Any] = MappingProxyType(
    {
        "phase.offsets": np.zeros(1),
        "phase.standing_threshold": 0.1,
        "phase.standing_value": None,
        "phase.standing_restarts": False,
    }
)
"""Options that mjlab's term `phase` implies, and those of Unitree's deployment of it: one clock, which runs on
while the robot stands; while |(vx, vy, yaw rate)| is below the threshold sine and cosine are both 0."""
_SCAN: Mapping[str, Any] = MappingProxyType(
    {"at": BASE, "grid": (1.6, 1.0), "resolution": 0.1, "ray_order": "xy", "offset": 0.0, "range": 5.0, "above": 0.0}
)
"""Height scan that mjlab 1.6 trains with (`terrain_scan` of its velocity task), and does not write down."""
_SCALE, _CLIP = "observation_terms_scale", "observation_terms_clip"
_HISTORY, _FLATTEN = "observation_terms_history_length", "observation_terms_flatten_history_dim"


def is_mjlab(metadata: Mapping[str, str]) -> bool:
    """Return whether the metadata has the keys by which this dialect is known."""
    return "joint_names" in metadata and ("joint_stiffness" in metadata or "observation_names" in metadata)


def read_mjlab(metadata: Mapping[str, str], where: str) -> PartialContract:
    """Return the keys that are there.

    The rate is not, and before mjlab 1.6 neither is how terms are scaled, clipped and stacked: the usual is assumed.
    The velocity of the base is that of the IMU where mjlab 1.6 or later has written the file: its tasks observe the
    velocimeter there. Files without its keys may be whole_body_tracking's, which observes the base itself.
    """
    known = {key: field for key, field in _FIELDS.items() if key in metadata}
    fields = {field: values.csv_field(field, key, metadata[key], where, MJLAB_SOURCE) for key, field in known.items()}
    names = fields["observation"].value if "observation" in fields else ()
    has_clock = any(term_kind(name).requires == "phase" for name in names)
    # In training, the first observation shows the clock as it starts.
    clock = {**GAIT_CLOCK, "phase.advance_first": False} if has_clock else {}
    return PartialContract(
        MJLAB_SOURCE,
        fields,
        _terms(metadata, names, where),
        assumed=assumed("mjlab", {"policy_dt": 0.02, "reference_quaternion": "wxyz"} | clock),
        assumed_terms=assumed("mjlab", {"scale": 1.0, "history": 1}),
        assumed_kinds={
            HEIGHT_SCAN: assumed("mjlab", _SCAN),
            **({"base_lin_vel": assumed("mjlab", {"at": IMU})} if _SCALE in metadata else {}),
        },
    )


def _terms(metadata: Mapping[str, str], names: Sequence[str], where: str) -> dict[str, dict[str, Given]]:
    """Return the options of each term that mjlab 1.6 writes, one entry per term."""
    terms: dict[str, dict[str, Given]] = {name: {} for name in names}
    readers: dict[str, Callable[[str], list[dict[str, Any]]]] = {
        _SCALE: lambda text: [
            {"scale": row[0] if len(row) == 1 else np.array(row)} for row in values.number_lists(_SCALE, text, where)
        ],
        _CLIP: lambda text: [_clip(row, text, where) for row in values.number_lists(_CLIP, text, where)],
        # 0 stands for a term without a history: it shows the present step alone.
        _HISTORY: lambda text: [{"history": max(n, 1)} for n in values.integers(_HISTORY, text, where)],
    }
    for key, read in readers.items():
        if key not in metadata:
            continue
        rows = read(metadata[key])
        if len(rows) != len(names):
            raise InputError(f"{where}: {key} has {len(rows)} entries, expected {len(names)}, one for each term")
        for name, options in zip(names, rows, strict=True):
            terms[name] |= given(MJLAB_SOURCE, options)
    flat = values.flags(_FLATTEN, metadata.get(_FLATTEN, ""), where)
    for (name, own), is_flat in zip(terms.items(), flat, strict=False):
        if not is_flat and "history" in own and own["history"].value > 1:  # which makes an observation of rank 3
            raise InputError(f"{where}: {_FLATTEN} is False for {name}, expected True: the observation has to be flat")
    return terms


def _clip(row: list[float], text: str, where: str) -> dict[str, Any]:
    if len(row) != 2:
        raise InputError(f"{where}: {_CLIP} is {text!r}, expected two numbers for each term, least;greatest")
    return {} if row == [-np.inf, np.inf] else {"clip": (row[0], row[1])}
