"""The `lerobot` package: optional, and slow to import, because it brings PyTorch."""

from __future__ import annotations

import importlib
import json
import os
from pathlib import Path
from typing import Any

from humanoid_sim.errors import InputError, MissingPackageError

__all__ = ["FORMAT", "dataset_info", "import_lerobot"]

FORMAT = "v3.0"
"""Version of the dataset format that is read and written."""


def import_lerobot(module: str, purpose: str, *, offline: bool) -> Any:
    """A module of `lerobot`.

    Args:
        module: such as `datasets.utils`.
        purpose: what needs it, for the message.
        offline: keep it from asking the hub for files that a local dataset lacks.

    Raises:
        MissingPackageError: with the install command.
        InputError: if the version that is installed has no such module.
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


def dataset_info(folder: Path) -> dict[str, Any]:
    """The `meta/info.json` of a local dataset, of the right version.

    Raises:
        InputError: if the folder is no such dataset.
    """
    path = folder / "meta" / "info.json"
    try:
        info = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{folder}: is no LeRobot dataset: it has no meta/info.json") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise InputError(f"{path}: is not JSON: {error}") from None
    version = info.get("codebase_version") if isinstance(info, dict) else None
    if version != FORMAT:
        raise InputError(
            f"{folder}: is a LeRobot dataset of format {version}, expected {FORMAT}; convert older ones with "
            "python -m lerobot.datasets.v30.convert_dataset_v21_to_v30"
        )
    found: dict[str, Any] = info
    return found
