"""Motions from LeRobot datasets (format v3.0), local or from the hub, through the `lerobot` library."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.prepare.features import episode_motion
from humanoid_sim.prepare.lerobot_library import dataset_info, import_lerobot
from humanoid_sim.prepare.source import SourceMotion

__all__ = ["read_hub_dataset", "read_local_dataset"]

_PURPOSE = "reading a LeRobot dataset"


def read_local_dataset(
    folder: Path, episode: int | None, roles: dict[str, str], joint_names: tuple[str, ...]
) -> SourceMotion:
    """One episode of a dataset in a folder. The network is not asked for anything.

    Args:
        folder: that holds `meta` and `data`.
        episode: index; None if there is only one.
        roles: features whose names are not the usual ones, by role.
        joint_names: of the robot.

    Raises:
        InputError: one line with the folder and what is wrong with it.
    """
    dataset_info(folder)
    datasets = import_lerobot("datasets.lerobot_dataset", _PURPOSE, offline=True)
    with _one_line(str(folder)):
        meta = datasets.LeRobotDatasetMetadata(f"local/{folder.name}", root=folder)
    return _episode(meta, folder, str(folder), episode, roles, joint_names)


def read_hub_dataset(
    repo_id: str, episode: int | None, roles: dict[str, str], joint_names: tuple[str, ...], timeout: float
) -> SourceMotion:
    """One episode of a dataset on the hub; only its metadata and the file of that episode are fetched, and kept.

    Args:
        repo_id: user/name.
        episode: index; None if there is only one.
        roles: features whose names are not the usual ones, by role.
        joint_names: of the robot.
        timeout: s to wait for the hub.

    Raises:
        InputError: one line with the dataset and what is wrong with it.
    """
    if repo_id.count("/") != 1:
        raise InputError(f"--dataset: is '{repo_id}', expected user/name")
    constants = import_lerobot("utils.constants", _PURPOSE, offline=False)
    kept = Path(constants.HF_LEROBOT_HOME) / repo_id
    if (kept / "meta" / "info.json").is_file():
        dataset_info(kept)
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
    """Whether the hub is there and has the dataset, before anything waits for it."""
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
        raise InputError(f"--dataset: the hub answers for '{repo_id}': {' '.join(str(error).split())}") from None
    except Exception as error:
        reason = "HF_HUB_OFFLINE is set" if os.environ.get("HF_HUB_OFFLINE") else type(error).__name__
        raise InputError(
            f"--dataset: the hub cannot be reached ({reason}) and '{repo_id}' was not fetched before; "
            "--motion takes a folder"
        ) from None


class _one_line:  # noqa: N801 - reads as a word at its call
    """What the library raises about a bad dataset becomes one line."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        if error is not None and isinstance(error, Exception) and not isinstance(error, InputError):
            reason = " ".join(str(error).split())[:300] or type(error).__name__
            raise InputError(f"{self._name}: cannot be read as a LeRobot dataset: {reason}") from None


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
