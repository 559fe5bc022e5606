"""Motions from LeRobot datasets (format v3.0), local or from the hub.

The features that hold a motion are found by their usual names, or by those that the user gives. The `lerobot` package
is optional, and slow to import, because it brings PyTorch.
"""

from __future__ import annotations

import importlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from humanoid_sim.controllers.rotation import quaternion_from_matrix, rotation_from_6d
from humanoid_sim.errors import InputError, meant, needing, one_line, reason_of
from humanoid_sim.files import is_file, regular_file
from humanoid_sim.mit import FloatArray
from humanoid_sim.prepare.source_motion import SourceMotion, joint_of

_FORMAT = "v3.0"
"""Version of the dataset format that is read and written."""
_PURPOSE = "reading a LeRobot dataset"
ROLES: Mapping[str, tuple[str, ...]] = {
    "joint_pos": ("joint_pos", "joint_position", "joint_positions", "qpos", "state"),
    "joint_vel": ("joint_vel", "joint_velocity", "joint_velocities", "velocity"),
    "body_pos_b": ("motion_body_pos_b", "body_pos_b"),
    "body_ori_b": ("motion_body_ori_b", "body_ori_b"),
    "body_quat_b": ("body_quat_b",),
    "body_pos_w": ("body_pos_w",),
    "body_quat_w": ("body_quat_w",),
    "base_pos": ("base_pos", "root_pos", "base_position"),
    "base_quat": ("base_quat", "root_quat", "base_orientation"),
}
"""Roles of features, and the last part of the names under which each is known, the surest first."""

_LAST_AXIS = {"body_pos_b": 3, "body_ori_b": 6, "body_quat_b": 4, "body_pos_w": 3, "body_quat_w": 4}
_GAPS = 0.1
"""Share of a frame that timestamps may be off."""


def import_lerobot(module: str, purpose: str, *, offline: bool) -> Any:
    """Return a module of `lerobot`, such as `datasets.utils`; `purpose` is what needs it, for the message.

    With `offline` it does not ask the hub for files that a local dataset lacks. Raises `MissingPackageError`, or
    `InputError` if the version that is installed has no such module.
    """
    if offline:
        # Read when the hub's package is imported; a local dataset must not wait for the network.
        os.environ.setdefault("HF_HUB_OFFLINE", "1")
    with needing("lerobot", "lerobot", purpose):
        importlib.import_module("lerobot")
    try:
        return importlib.import_module(f"lerobot.{module}")
    except ModuleNotFoundError as error:
        raise InputError(f"{purpose}: lerobot is installed, but lacks '{error.name}'; install lerobot 0.4") from None


def _check_format(folder: Path) -> None:
    """Refuse a folder that holds no dataset of the right version."""
    path = folder / "meta" / "info.json"
    try:
        if not is_file(path):
            raise InputError(f"{folder}: is not a LeRobot dataset: it has no meta/info.json")
        info = json.loads(regular_file(path, "a dataset's info.json").read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise InputError(f"{path}: is not JSON: {error}") from None
    version = info.get("codebase_version") if isinstance(info, dict) else None
    if version != _FORMAT:
        shown = one_line(str(version))[:80]
        raise InputError(
            f"{folder}: is a LeRobot dataset of format {shown}, expected {_FORMAT}; convert older ones with "
            "python -m lerobot.datasets.v30.convert_dataset_v21_to_v30"
        )


def read_local_dataset(
    folder: Path, episode: int | None, roles: dict[str, str], joint_names: tuple[str, ...]
) -> SourceMotion:
    """One episode of a dataset in a folder that holds `meta` and `data`. Nothing is fetched from the network.

    The rest as `read_hub_dataset`.
    """
    _check_format(folder)
    datasets = import_lerobot("datasets.lerobot_dataset", _PURPOSE, offline=True)
    with _one_line(str(folder)):
        meta = datasets.LeRobotDatasetMetadata(f"local/{folder.name}", root=folder)
    return _episode(meta, folder, str(folder), episode, roles, joint_names)


def read_hub_dataset(
    repo_id: str, episode: int | None, roles: dict[str, str], joint_names: tuple[str, ...], timeout: float
) -> SourceMotion:
    """One episode of a dataset on the hub; only its metadata and the file of that episode are fetched, and kept.

    The dataset's id is user/name; the episode an index, None if there is only one; `roles` has features whose names are
    not the usual ones, by role. The hub is waited for `timeout` s.
    """
    if repo_id.count("/") != 1:
        raise InputError(f"--dataset: is '{repo_id}', expected user/name")
    constants = import_lerobot("utils.constants", _PURPOSE, offline=False)
    kept = Path(constants.HF_LEROBOT_HOME) / repo_id
    if (kept / "meta" / "info.json").is_file():
        _check_format(kept)
    else:
        _ask_hub(repo_id, timeout)
    datasets = import_lerobot("datasets.lerobot_dataset", _PURPOSE, offline=False)
    with _one_line(repo_id):
        meta = datasets.LeRobotDatasetMetadata(repo_id)
        chosen = _choose_episode(repo_id, episode, int(meta.total_episodes))
        file = meta.get_data_file_path(chosen)
        if not (Path(meta.root) / file).is_file():
            _ask_hub(repo_id, timeout)
            meta.pull_from_repo(allow_patterns=str(file))
    return _episode(meta, Path(meta.root), repo_id, chosen, roles, joint_names)


def _ask_hub(repo_id: str, timeout: float) -> None:
    """Ask whether the hub is there and has the dataset, before anything waits for it."""
    os.environ.setdefault("HF_HUB_ETAG_TIMEOUT", str(max(1, round(timeout))))
    from huggingface_hub import HfApi  # noqa: PLC0415 - comes with lerobot
    from huggingface_hub.errors import HfHubHTTPError, RepositoryNotFoundError  # noqa: PLC0415

    try:
        HfApi().dataset_info(repo_id, timeout=timeout)
    except RepositoryNotFoundError:
        raise InputError(
            f"--dataset: the hub has no dataset '{repo_id}', or it is private; --motion takes a folder"
        ) from None
    except HfHubHTTPError as error:
        raise InputError(f"--dataset: the hub answers for '{repo_id}': {reason_of(error)}") from None
    except Exception as error:
        reason = "HF_HUB_OFFLINE is set" if os.environ.get("HF_HUB_OFFLINE") else type(error).__name__
        raise InputError(
            f"--dataset: the hub cannot be reached ({reason}) and '{repo_id}' was not fetched before; "
            "--motion takes a folder"
        ) from None


@contextmanager
def _one_line(name: str) -> Iterator[None]:
    """Turn what the library raises about a bad dataset into one line."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{name}: cannot be read as a LeRobot dataset: {reason_of(error)[:300]}") from None


def _choose_episode(name: str, episode: int | None, count: int) -> int:
    if episode is None:
        if count != 1:
            raise InputError(f"{name}: has {count} episodes; choose one with --episode, 0 to {count - 1}")
        return 0
    if not 0 <= episode < count:
        raise InputError(f"--episode: is {episode}, but {name} has the episodes 0 to {count - 1}")
    return episode


def _episode(
    meta: Any, root: Path, name: str, episode: int | None, roles: dict[str, str], joint_names: tuple[str, ...]
) -> SourceMotion:
    chosen = _choose_episode(name, episode, int(meta.total_episodes))
    utils = import_lerobot("datasets.utils", _PURPOSE, offline=False)
    cameras = set(meta.camera_keys)
    with _one_line(name):
        expected = int(meta.episodes[chosen]["length"])
        table = utils.load_nested_dataset(root / "data", episodes=[chosen])
        numeric = [
            key
            for key, value in meta.features.items()
            if key not in cameras and str(value["dtype"]).startswith(("float", "int"))
        ]
        table = table.select_columns([key for key in numeric if key in table.column_names]).with_format("numpy")
        columns = {key: np.stack(list(table[key])).astype(np.float64) for key in table.column_names}
    if len(table) != expected:
        raise InputError(f"{name}: episode {chosen} has {len(table)} frames, its metadata say {expected}")
    names = {key: value.get("names") for key, value in meta.features.items()}
    return episode_motion(f"{name} episode {chosen}", columns, names, float(meta.fps), roles, joint_names)


def parse_roles(options: Iterable[str]) -> dict[str, str]:
    """`--features joint_pos=observation.qpos …` as a mapping from role to feature."""
    roles = {}
    for option in options:
        role, equals, feature = option.partition("=")
        if not equals or role not in ROLES or not feature:
            near = "" if role in ROLES else meant(role, ROLES)
            raise InputError(
                f"--features: is '{option}'{near}, expected ROLE=FEATURE with a role of {', '.join(ROLES)}"
            )
        roles[role] = feature
    return roles


def episode_motion(
    source: str,
    columns: Mapping[str, FloatArray],
    names: Mapping[str, Any],
    fps: float,
    roles: Mapping[str, str],
    joint_names: tuple[str, ...],
) -> SourceMotion:
    """Return the motion in an episode's columns.

    Raises `InputError` if the columns hold no motion, or one that contradicts itself.

    Args:
        columns: numeric features, each (F, …).
        names: what the dataset calls the values of each feature, if it does.
        roles: features whose names are not the usual ones, by role.
    """
    found = _find(source, columns, roles)
    _check_times(source, columns.get("timestamp"), fps)
    joints, joint_columns = _joints(source, columns, found, names, joint_names)
    world = "body_pos_w" in found
    suffix = "w" if world else "b"
    position = _bodies(source, columns, found, f"body_pos_{suffix}")
    quaternion = _bodies(source, columns, found, f"body_quat_{suffix}")
    if quaternion is None and not world:
        columns_6d = _bodies(source, columns, found, "body_ori_b")
        quaternion = None if columns_6d is None else quaternion_from_matrix(rotation_from_6d(columns_6d))
    count = 0 if position is None else position.shape[1]
    velocity = columns[found["joint_vel"]] if "joint_vel" in found else None
    if "joint_pos" not in found and position is None:
        raise InputError(
            f"{source}: has no feature with joint positions or body poses; it has {', '.join(sorted(columns))}; "
            "say which is which with --features joint_pos=…"
        )
    return SourceMotion(
        source=source,
        kind="lerobot",
        fps=fps,
        joint_position=columns[found["joint_pos"]][:, joint_columns] if "joint_pos" in found else None,
        joint_velocity=velocity if velocity is not None and velocity.shape[1] == len(joint_columns) else None,
        joint_names=joints,
        body_position=position,
        body_quaternion=quaternion,
        body_names=() if position is None else _body_names(names.get(found[f"body_pos_{suffix}"]), count),
        base_position=columns[found["base_pos"]] if "base_pos" in found else None,
        base_quaternion=columns[found["base_quat"]] if "base_quat" in found else None,
        frame="world" if world else "base",
    )


def _find(source: str, columns: Mapping[str, FloatArray], roles: Mapping[str, str]) -> dict[str, str]:
    found = {}
    for role, feature in roles.items():
        if feature not in columns:
            lacks = f"{source} has no feature '{feature}'{meant(feature, columns)}"
            raise InputError(f"--features: {lacks}; it has {', '.join(sorted(columns))}")
        found[role] = feature
    # What `record dataset --reference` adds: the motion itself, next to what the robot made of it.
    references = [key for key in columns if key.startswith("reference.")]
    for role, known in ROLES.items():
        for word in known:
            keys = [key for key in references or columns if key.rpartition(".")[2] == word and columns[key].ndim > 1]
            if len(keys) > 1:
                keys = [key for key in keys if key.startswith("observation.")] or keys
            if role not in found and keys:
                found[role] = keys[0]
    return found


def _joints(
    source: str,
    columns: Mapping[str, FloatArray],
    found: Mapping[str, str],
    names: Mapping[str, Any],
    joint_names: tuple[str, ...],
) -> tuple[tuple[str, ...] | None, list[int]]:
    """Names of the joint columns as the dataset has them, and which columns they are; no names: all columns."""
    if "joint_pos" not in found:
        return None, []
    listed = _flat(names.get(found["joint_pos"]))
    places: dict[str, int] = {}
    for place, name in enumerate(listed):
        joint = joint_of(name, joint_names)
        if joint is not None:
            places.setdefault(joint, place)
    if not places:
        return None, list(range(columns[found["joint_pos"]].shape[1]))
    missing = [joint for joint in joint_names if joint not in places]
    if missing:
        raise InputError(f"{source}: feature '{found['joint_pos']}' has no {', '.join(missing)}")
    return tuple(places), list(places.values())


def _bodies(source: str, columns: Mapping[str, FloatArray], found: Mapping[str, str], role: str) -> FloatArray | None:
    """Return a feature of bodies as (F, B, 3), (F, B, 4) or (F, B, 6), whether it is stored flat or not."""
    if role not in found:
        return None
    array, width = columns[found[role]], _LAST_AXIS[role]
    if array.ndim == 2 and array.shape[1] % width == 0:
        return array.reshape(len(array), -1, width)
    if array.ndim == 3 and array.shape[2] == width:
        return array
    raise InputError(
        f"{source}: feature '{found[role]}' has shape {array.shape[1:]} per frame, expected {width} values per body"
    )


def _body_names(names: Any, count: int) -> tuple[str, ...]:
    """Names of bodies from names of values: `left_hand.x, left_hand.y, …`, or one name per body."""
    listed = _flat(names)
    if len(listed) == count:
        return tuple(listed)
    heads = [name.rpartition(".")[0] for name in listed]
    bodies = list(dict.fromkeys(heads))
    if all(heads) and len(bodies) == count and heads == [body for body in bodies for _ in range(3)]:
        return tuple(bodies)
    return ()


def _flat(names: Any) -> list[str]:
    """Return a dataset's names as a list: some writers nest them as `{"motors": [...]}`."""
    if isinstance(names, Mapping):
        return [name for value in names.values() for name in _flat(value)]
    if isinstance(names, str):
        return [names]
    return [text for name in names or () for text in _flat(name)]


def _check_times(source: str, times: FloatArray | None, fps: float) -> None:
    """Frames must be as far apart as the dataset's frame rate says."""
    if times is None or len(times) < 2:
        return
    steps = np.diff(times.reshape(-1))
    worst = int(np.abs(steps - 1.0 / fps).argmax())
    if abs(steps[worst] * fps - 1.0) > _GAPS:
        raise InputError(
            f"{source}: timestamp rises by {steps[worst]:.4g} s after frame {worst}, but fps is {fps:g}; "
            f"expected {1.0 / fps:.4g} s"
        )
