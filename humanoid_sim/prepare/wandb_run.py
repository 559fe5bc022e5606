"""Checkpoints of Weights & Biases runs, fetched by the API of the package `wandb`."""

from __future__ import annotations

import re
import threading
from pathlib import Path
from typing import Any

from humanoid_sim.errors import InputError, needing, reason_of

WAIT = 30.0
"""s without an answer after which W&B is given up: the package itself tries again for days."""


def fetch_checkpoint(run_path: str, name: str | None, folder: Path) -> Path:
    """Download a run's checkpoint, and the `.data` file of its external tensors if it has one, to a folder.

    Without a name it is the `model_*.onnx` with the largest number, else the only `.onnx`.
    """
    if not re.fullmatch(r"[^/\s]+/[^/\s]+/[^/\s]+", run_path):
        raise InputError(f"--wandb-run-path: is '{run_path}', expected entity/project/run")
    files = _run_files(run_path)
    chosen = name or _newest(run_path, list(files))
    if chosen not in files:
        raise InputError(f"--wandb-file: run {run_path} has no '{chosen}'; it has: {', '.join(sorted(files))}")
    for file_name in {chosen, f"{chosen}.data"} & files.keys():
        if not (folder / file_name).resolve().is_relative_to(folder.resolve()):
            raise InputError(f"--wandb-file: is '{file_name}', expected a name inside the run's folder")
        try:
            files[file_name].download(root=str(folder), replace=True).close()
        except Exception as error:  # of a disk, of the network, or of the package's own
            raise InputError(f"--wandb-run-path: '{file_name}' of {run_path}: {reason_of(error)[:200]}") from None
    return folder / chosen


def _run_files(run_path: str) -> dict[str, Any]:
    """Return the run's files by name, asked for in a thread: it ends with the process, should it hang."""
    with needing("wandb", "wandb", "--wandb-run-path"):
        import wandb  # noqa: PLC0415 - optional, and slow to import
    answers: list[dict[str, Any] | Exception] = []

    def ask() -> None:
        try:
            answers.append({file.name: file for file in wandb.Api(timeout=round(WAIT)).run(run_path).files()})
        except Exception as error:
            answers.append(error)

    thread = threading.Thread(target=ask, name="wandb", daemon=True)
    thread.start()
    thread.join(WAIT)
    answer = answers[0] if answers else TimeoutError(f"no answer within {WAIT:g} s; is this machine logged in?")
    if isinstance(answer, Exception):
        raise InputError(f"--wandb-run-path: run {run_path} cannot be read: {reason_of(answer)[:200]}")
    return answer


def _newest(run_path: str, names: list[str]) -> str:
    exported = [name for name in names if name.endswith(".onnx")]
    models = [name for name in exported if re.fullmatch(r"model_\d+\.onnx", Path(name).name)]
    if models:
        return max(models, key=lambda name: int(Path(name).stem.removeprefix("model_")))
    if len(exported) == 1:
        return exported[0]
    problem = "several .onnx files; choose one with --wandb-file" if exported else "no .onnx file"
    raise InputError(f"--wandb-run-path: run {run_path} has {problem}; it has: {', '.join(sorted(names)) or 'none'}")
