"""Checkpoints of Weights & Biases runs: found, fetched once, and kept in the user's cache folder."""

from __future__ import annotations

import base64
import hashlib
import os
import re
import shutil
import threading
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from pathlib import Path
from typing import Any, TypeVar

from humanoid_sim.errors import InputError, needing, reason_of

_RUN_PATH = re.compile(r"^[^/\s]+/[^/\s]+/[^/\s]+$")
_NUMBER = re.compile(r"\d+")

T = TypeVar("T")


def cache_folder() -> Path:
    """Return where checkpoints are kept: `humanoid_sim/wandb` in the user's cache."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "humanoid_sim" / "wandb"


def fetch_checkpoint(run_path: str, name: str | None, *, timeout: float) -> tuple[Path, str]:
    """Return a run's checkpoint as a local file, with the `.data` file of its external tensors if it has one.

    The newest `model_*.onnx` of the run's files by its number, else its only `.onnx`; failing that, the newest logged
    artifact with such a file. A file that is in the cache with the right digest is not fetched again. Raises
    `InputError` if the run or the file does not exist, or the network is not there.

    Gives up after `timeout` s without an answer about the run and its files. Returns the path, and a notice for the
    user or ''.
    """
    run_path = run_path.strip().removeprefix("wandb://").strip("/")
    if not _RUN_PATH.match(run_path):
        raise InputError(f"--wandb-run-path: is '{run_path}', expected entity/project/run")
    with needing("wandb", "wandb", "--wandb-run-path"):
        import wandb  # noqa: PLC0415 - optional, and slow to import
    folder = cache_folder() / run_path
    try:
        run = _within(timeout, lambda: wandb.Api(timeout=max(1, round(timeout))).run(run_path))
        files = {file.name: file for file in _within(timeout, lambda: _run_files(run))}
        chosen = _choose(run_path, name, files)
    except _UnreachableError as error:
        return _from_cache(run_path, name, folder, str(error))
    wanted = [chosen, *([f"{chosen}.data"] if f"{chosen}.data" in files else [])]
    for file_name in wanted:
        _download(run_path, files[file_name], folder)
    return folder / chosen, ""


class _UnreachableError(Exception):
    """No answer from the service."""


def _within(timeout: float, function: Callable[[], T]) -> T:
    """Return the result of a call that may hang, made in a thread that ends with the process."""
    answer: Future[T] = Future()

    def call() -> None:
        try:
            answer.set_result(function())
        except BaseException as error:
            answer.set_exception(error)

    threading.Thread(target=call, name="wandb", daemon=True).start()
    try:
        return answer.result(timeout)
    except FutureTimeout:
        reason = f"no answer within {timeout:g} s (is this machine logged in? try: wandb login)"
        raise _UnreachableError(reason) from None
    except Exception as error:
        raise _told(error) from None


def _told(error: BaseException) -> Exception:
    """Return what an error of wandb means for the user: by the names of its types, which differ between versions."""
    names = {kind.__name__ for link in _chain(error) for kind in type(link).__mro__}
    offline = {"ConnectionError", "ConnectTimeout", "Timeout", "TimeoutError", "ConnectError", "gaierror"}
    if names & offline:
        return _UnreachableError("no connection")
    return InputError(f"--wandb-run-path: {reason_of(error)[:200]}")


def _chain(error: BaseException) -> list[BaseException]:
    found: list[BaseException] = []
    link: BaseException | None = error
    while link is not None and link not in found:
        found.append(link)
        link = link.__cause__ or link.__context__ or getattr(link, "exc", None)
    return found


def _run_files(run: Any) -> list[Any]:
    """Files of the run; where none of them is a checkpoint, those of its newest artifact that holds one."""
    files = list(run.files())
    if any(file.name.endswith(".onnx") for file in files):
        return files
    for artifact in reversed(list(run.logged_artifacts())):
        inside = list(artifact.files())
        if any(file.name.endswith(".onnx") for file in inside):
            return inside
    return files


def _choose(run_path: str, name: str | None, files: dict[str, Any]) -> str:
    listed = ", ".join(sorted(files)) or "none"
    if name is not None:
        if name not in files:
            raise InputError(f"--wandb-file: run {run_path} has no '{name}'; it has: {listed}")
        return name
    onnx = [file for file in files if file.endswith(".onnx")]
    models = [file for file in onnx if Path(file).name.startswith("model_")]
    if models:
        return max(models, key=_iteration)
    if len(onnx) == 1:
        return onnx[0]
    if onnx:
        raise InputError(
            f"--wandb-run-path: run {run_path} has several .onnx files; choose with --wandb-file: {listed}"
        )
    raise InputError(f"--wandb-run-path: run {run_path} has no .onnx file (export the checkpoint); it has: {listed}")


def _iteration(name: str) -> tuple[int, str]:
    numbers = _NUMBER.findall(Path(name).name)
    return (int(numbers[-1]) if numbers else -1), name


def _from_cache(run_path: str, name: str | None, folder: Path, reason: str) -> tuple[Path, str]:
    """Return what was fetched before, when the service cannot be asked: a file by name, never a guess at the newest."""
    if name is not None and (folder / name).is_file():
        return folder / name, f"W&B: {reason}; {name} is the copy in {folder}"
    kept = sorted(path.name for path in folder.glob("*.onnx")) if folder.is_dir() else []
    hint = f"; fetched before: {', '.join(kept)} (choose one with --wandb-file)" if kept else "; --policy takes a file"
    raise InputError(f"--wandb-run-path: run {run_path} cannot be reached: {reason}{hint}")


def _download(run_path: str, file: Any, folder: Path) -> None:
    target = folder / file.name
    if ".." in Path(file.name).parts or Path(file.name).is_absolute():  # whatever the run's owner called it
        raise InputError(f"--wandb-run-path: run {run_path} has a file '{file.name}', expected a name inside a folder")
    if target.is_file() and _is_same(target, file):
        return
    incoming = folder / f".incoming-{os.getpid()}"
    partial = incoming / file.name
    try:
        incoming.mkdir(parents=True, exist_ok=True)
        file.download(root=str(incoming), replace=True).close()
        if not partial.is_file() or not _is_same(partial, file):
            raise InputError(f"--wandb-run-path: '{file.name}' of run {run_path} arrived incomplete; try again")
        target.parent.mkdir(parents=True, exist_ok=True)
        partial.replace(target)
    except InputError:
        raise
    except Exception as error:  # of a disk, of the network, or of the package's own
        raise InputError(f"--wandb-run-path: fetching '{file.name}' of run {run_path}: {reason_of(error)}") from None
    finally:
        shutil.rmtree(incoming, ignore_errors=True)


def _is_same(path: Path, file: Any) -> bool:
    """Return whether a local file is the run's, by its MD5 as W&B gives it, or by its size where it gives none."""
    digest = getattr(file, "md5", None)
    if digest:
        local = hashlib.md5(path.read_bytes(), usedforsecurity=False).digest()
        return digest in (base64.b64encode(local).decode(), local.hex())
    return path.stat().st_size == int(getattr(file, "size", -1) or -1)
