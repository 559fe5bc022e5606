"""Checkpoints of Weights & Biases runs, fetched by the API of the package `wandb`."""

from __future__ import annotations

import re
import threading
from pathlib import Path
from typing import Any

from humanoid_sim.errors import InputError, blaming, needing, reason_of

_WAIT = 30.0  # s for an answer; the package itself tries again for hours


def fetch_checkpoint(run_path: str, name: str | None, folder: Path) -> Path:
    """Download a run's checkpoint, and the `.data` file of its external tensors if it has one, to a folder.

    Without a name it is the `model_*.onnx` with the largest number, else the only `.onnx`.
    """
    files = _run_files(run_path)
    chosen = name or _newest(list(files))
    if chosen not in files or not (folder / chosen).resolve().is_relative_to(folder.resolve()):
        known = ", ".join(sorted(files)) or "none"
        raise InputError(f"--wandb-file: is {chosen or 'missing'}, expected a checkpoint of run {run_path}: {known}")
    for file_name in {chosen, f"{chosen}.data"} & files.keys():
        with blaming(f"--wandb-run-path: '{file_name}' of {run_path}", Exception):  # of a disk too
            files[file_name].download(root=str(folder), replace=True).close()
    return folder / chosen


def _run_files(run_path: str) -> dict[str, Any]:
    """Return the run's files by name, requested by a thread that ends with the process if it hangs."""
    with needing("wandb", "wandb", "--wandb-run-path"):
        import wandb  # noqa: PLC0415 - optional, and slow to import
    answers: list[dict[str, Any] | Exception] = []

    def request() -> None:
        try:
            answers.append({file.name: file for file in wandb.Api(timeout=round(_WAIT)).run(run_path).files()})
        except Exception as error:  # of the network, or of the package's own
            answers.append(error)

    thread = threading.Thread(target=request, name="wandb", daemon=True)
    thread.start()
    thread.join(_WAIT)
    answer = answers[0] if answers else TimeoutError(f"no answer within {_WAIT:g} s; is this machine logged in?")
    if isinstance(answer, Exception):
        raise InputError(f"--wandb-run-path: run {run_path} cannot be read: {reason_of(answer)[:200]}")
    return answer


def _newest(names: list[str]) -> str:
    exported = [name for name in names if name.endswith(".onnx")]
    models = [name for name in exported if re.fullmatch(r"model_\d+\.onnx", Path(name).name)]
    if models:
        return max(models, key=lambda name: int(Path(name).stem.removeprefix("model_")))
    return exported[0] if len(exported) == 1 else ""
