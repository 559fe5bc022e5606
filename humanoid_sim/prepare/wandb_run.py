"""Checkpoints of Weights & Biases runs, fetched by the API of the package `wandb`."""

from __future__ import annotations

import re
from pathlib import Path

from humanoid_sim.errors import InputError, blaming, needing

_TIMEOUT = 30  # s for an answer


def fetch_checkpoint(run_path: str, name: str | None, folder: Path) -> Path:
    """Download a run's checkpoint, and the `.data` file of its external tensors if it has one, to a folder.

    Without a name it is the `model_*.onnx` with the largest number, else the only `.onnx`.
    """
    with needing("wandb", "wandb", "--wandb-run-path"):
        import wandb  # noqa: PLC0415 - optional, and slow to import
    with blaming(f"--wandb-run-path: run {run_path} cannot be read", Exception):  # of the network, or the package's own
        files = {file.name: file for file in wandb.Api(timeout=_TIMEOUT).run(run_path).files()}
    chosen = name or _newest(list(files))
    if chosen not in files or not (folder / chosen).resolve().is_relative_to(folder.resolve()):
        known = ", ".join(sorted(files)) or "none"
        raise InputError(f"--wandb-file: is {chosen or 'missing'}, expected a checkpoint of run {run_path}: {known}")
    for file_name in {chosen, f"{chosen}.data"} & files.keys():
        with blaming(f"--wandb-run-path: '{file_name}' of {run_path}", Exception):  # of a disk too
            files[file_name].download(root=str(folder), replace=True).close()
    return folder / chosen


def _newest(names: list[str]) -> str:
    exported = [name for name in names if name.endswith(".onnx")]
    models = [name for name in exported if re.fullmatch(r"model_\d+\.onnx", Path(name).name)]
    if models:
        return max(models, key=lambda name: int(Path(name).stem.removeprefix("model_")))
    return exported[0] if len(exported) == 1 else ""
