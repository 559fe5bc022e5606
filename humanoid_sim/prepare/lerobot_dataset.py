"""Motions from LeRobot datasets (format v3.0), local or from the hub.

The `lerobot` package is optional, and slow to import, because it brings PyTorch.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from humanoid_sim.bounds import JSON_BYTES
from humanoid_sim.errors import InputError, MissingPackageError, one_line, reason_of
from humanoid_sim.files import is_file, regular_file
from humanoid_sim.prepare.dataset_features import episode_motion
from humanoid_sim.prepare.source_motion import SourceMotion
from humanoid_sim.strict_json import parse_json

_FORMAT = "v3.0"
"""Version of the dataset format that is read and written."""
_PURPOSE = "reading a LeRobot dataset"


def import_lerobot(module: str, purpose: str, *, offline: bool) -> Any:
    """Return a module of `lerobot`, such as `datasets.utils`; `purpose` is what needs it, for the message.

    With `offline` it does not ask the hub for files that a local dataset lacks. Raises `MissingPackageError`, or
    `InputError` if the version that is installed has no such module.
    """
    if offline:
        # Read when the hub's package is imported; a local dataset must not wait for the network.
        os.environ.setdefault("HF_HUB_OFFLINE", "1")
    try:
        importlib.import_module("lerobot")
    except ImportError:
        raise MissingPackageError("lerobot", "lerobot", purpose) from None
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
        info = parse_json(regular_file(path, "a dataset's info.json", JSON_BYTES).read_text(encoding="utf-8"))
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
