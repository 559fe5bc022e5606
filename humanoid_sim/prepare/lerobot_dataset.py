"""Motions from LeRobot datasets (format v3.0), in a folder or from the hub; LeRobot itself is not needed."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from humanoid_sim.controllers.rotation import quaternion_from_matrix, rotation_from_6d
from humanoid_sim.errors import InputError, blaming, needing, one_line, reason_of, require_known
from humanoid_sim.files import regular_file
from humanoid_sim.mit import FloatArray
from humanoid_sim.prepare.sources import SourceMotion, even_times, joint_of, poses

_FORMAT = "v3.0"
_WIDTHS = {"body_pos_w": 3, "body_quat_w": 4, "motion_body_pos_b": 3, "motion_body_ori_b": 6}
_EPISODE_COLUMNS = ["episode_index", "length", "data/chunk_index", "data/file_index"]
ROLES = ("joint_pos", "joint_vel", *_WIDTHS)
"""Parts of a motion; a feature whose name ends in one of them is it, and one that ends in `state` joint positions."""


def hub_dataset(name: str) -> Path:
    """Return the folder of a dataset on the hub: LeRobot's own copy, else fetched, without its videos."""
    cache = os.environ.get("HF_HOME", "~/.cache/huggingface")
    kept = Path(os.environ.get("HF_LEROBOT_HOME", f"{cache}/lerobot")).expanduser() / name
    if (kept / "meta").is_dir():
        return kept
    with needing("huggingface_hub", "lerobot", f"fetching the dataset '{name}'"):
        from huggingface_hub import snapshot_download  # noqa: PLC0415 - optional
    try:
        return Path(snapshot_download(name, repo_type="dataset", allow_patterns=["meta/*", "data/*"]))
    except Exception as error:  # of the network, of the hub, or of the package's own
        raise InputError(f"--motion: '{name}' cannot be fetched from the hub: {reason_of(error)[:200]}") from None


def read_dataset(folder: Path, episode: int | None, roles: Mapping[str, str], joints: tuple[str, ...]) -> SourceMotion:
    """Read one episode of a dataset; `roles` has the features that their names do not tell, by role."""
    with needing("pyarrow", "lerobot", "reading a LeRobot dataset"):
        from pyarrow import compute, parquet  # noqa: PLC0415 - optional
    with blaming(f"{folder}: cannot be read as a LeRobot dataset", (OSError, ValueError, KeyError, TypeError)):
        info = json.loads(regular_file(folder / "meta" / "info.json", "a dataset's info.json").read_bytes())
        if info["codebase_version"] != _FORMAT:
            version = one_line(str(info["codebase_version"]))[:80]
            converter = "convert it with LeRobot's convert_dataset_v21_to_v30"
            raise InputError(f"{folder}: has LeRobot's format {version}, expected {_FORMAT}; {converter}")
        listed = parquet.read_table(folder / "meta" / "episodes", columns=_EPISODE_COLUMNS).to_pylist()
        rows = {row["episode_index"]: row for row in listed}
        chosen = 0 if episode is None and len(rows) == 1 else episode
        if chosen not in rows:
            raise InputError(f"--episode: is {chosen}, expected one of the {len(rows)} episodes of {folder}, from 0")
        place = {name: rows[chosen][f"data/{name}"] for name in ("chunk_index", "file_index")}
        numeric = {key: its for key, its in info["features"].items() if its["dtype"].startswith(("float", "int"))}
        table = parquet.read_table(folder / info["data_path"].format(**place), columns=[*numeric])
        table = table.filter(compute.equal(table["episode_index"], chosen))
        if len(table) != rows[chosen]["length"]:
            raise InputError(f"{folder}: episode {chosen} has {len(table)} frames, not {rows[chosen]['length']}")
        columns = {key: np.array(table[key].to_pylist(), dtype=np.float64) for key in numeric}
        names = {key: _listed(its.get("names")) for key, its in numeric.items()}
        return episode_motion(f"{folder} episode {chosen}", columns, names, float(info["fps"]), roles, joints)


def _listed(names: Any) -> list[str]:
    """Return a feature's names of its values; some writers nest them as `{"motors": [...]}`."""
    nested = names.values() if isinstance(names, Mapping) else [names or []]
    return [str(name) for listed in nested for name in listed]


def parse_roles(options: tuple[str, ...]) -> dict[str, str]:
    """`--features joint_pos=observation.qpos …` as a mapping from role to feature."""
    roles = {role: feature for role, _, feature in (option.partition("=") for option in options)}
    require_known("role", roles, ROLES, "--features: expected ROLE=FEATURE: ")
    return roles


def episode_motion(
    source: str,
    columns: Mapping[str, FloatArray],
    names: Mapping[str, list[str]],
    fps: float,
    roles: Mapping[str, str],
    joints: tuple[str, ...],
) -> SourceMotion:
    """Return the motion in an episode's columns.

    Args:
        columns: numeric features, each (F, …).
        names: what the dataset calls the values of each feature; empty where it does not.
        roles: features that their names do not tell, by role.
    """
    found = _features(source, columns, roles)
    arrays = {role: columns[feature] for role, feature in found.items()}
    listed = names.get(found.get("joint_pos", ""), [])
    places = {joint: i for i, name in enumerate(listed) if (joint := joint_of(name, joints))}
    if places:
        require_known("joint", joints, places, f"{source}: {found['joint_pos']}: ")
        for role in ("joint_pos", "joint_vel"):
            if role in arrays and arrays[role].shape == columns[found["joint_pos"]].shape:
                arrays[role] = arrays[role][:, [places[joint] for joint in joints]]
    for role, width in _WIDTHS.items():
        if role in arrays:
            arrays[role] = arrays[role].reshape(len(arrays[role]), -1, width)
    if "motion_body_ori_b" in arrays:
        arrays["body_quat_b"] = quaternion_from_matrix(rotation_from_6d(arrays["motion_body_ori_b"]))
    frame: Literal["world", "base"] = "world" if "body_pos_w" in arrays else "base"
    place, turn = ("body_pos_w", "body_quat_w") if frame == "world" else ("motion_body_pos_b", "body_quat_b")
    if (place in arrays) != (turn in arrays):
        raise InputError(f"{source}: holds positions or orientations of bodies, expected both")
    heads = tuple(name.rpartition(".")[0] for name in names.get(found.get(place, ""), [])[::3])  # hand.x, hand.y, …
    return SourceMotion(
        source=source,
        kind="lerobot",
        times=columns["timestamp"] if "timestamp" in columns else even_times(len(columns["frame_index"]), fps, source),
        joints=arrays.get("joint_pos"),
        joint_velocity=arrays.get("joint_vel"),
        joint_names=joints if places else None,
        bodies=poses(arrays[place], arrays[turn], source) if place in arrays else None,
        body_names=heads if heads and all(heads) else None,
        frame=frame,
        quaternion_order="wxyz" if frame == "base" else None,
    )


def _features(source: str, columns: Mapping[str, FloatArray], roles: Mapping[str, str]) -> dict[str, str]:
    """Return the feature of each role; what `record dataset --reference` added comes before what the robot did."""
    require_known("feature", roles.values(), columns, f"--features: {source}: ")
    found = dict(roles)
    references = [key for key in columns if key.startswith("reference.")]
    for key in references or columns:
        role = key.rpartition(".")[2].replace("state", "joint_pos")
        if role in ROLES and role not in roles and columns[key].ndim > 1:
            if role in found:
                raise InputError(f"{source}: '{found[role]}' and '{key}' may be {role}; choose with --features")
            found[role] = key
    if not found:
        raise InputError(f"{source}: holds no motion that its names tell, but {', '.join(columns)}; use --features")
    return found
