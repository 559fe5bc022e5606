"""Baselines and results on disk: JSON, whole or not at all."""

from __future__ import annotations

from pathlib import Path

import msgspec

from humanoid_sim.errors import InputError
from humanoid_sim.files import regular_file, whole_file
from humanoid_sim.regress.results import PolicyRun

__all__ = ["read_baseline", "write_json"]


def write_json(path: Path, value: msgspec.Struct) -> None:
    """Write a result, indented, such that a difference of two files can be read.

    Raises:
        InputError: if the file cannot be written.
    """
    with whole_file(path) as file:
        file.write(msgspec.json.format(msgspec.json.encode(value), indent=1) + b"\n")


def _is_result(data: bytes) -> bool:
    """Whether a file is what `--json` writes: taken for a baseline more often than anything else."""
    try:
        document = msgspec.json.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError):
        return False
    return isinstance(document, dict) and "candidates" in document


def read_baseline(path: Path) -> PolicyRun:
    """A stored run.

    Raises:
        InputError: one line with the file and what is wrong with it.
    """
    try:
        data = regular_file(path, "a baseline (.json) or a checkpoint (.onnx)").read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    try:
        run = msgspec.json.decode(data, type=PolicyRun)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        if _is_result(data):
            raise InputError(f"{path}: is a result of --json, expected a baseline of --write-baseline") from None
        raise InputError(f"{path}: is no baseline of `regress --write-baseline`: {error}") from None
    if not run.episodes:
        raise InputError(f"{path}: holds no episodes, expected a baseline of `regress --write-baseline`")
    return run
