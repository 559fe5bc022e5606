"""The folder that `prepare` fills: all files, or none."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

from rich.console import Console

from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import Checkpoint, read_contract
from humanoid_sim.prepare.report import MotionReport, as_json

__all__ = ["Content", "Outputs", "checkpoint_files", "report_bytes"]

Content = bytes | Path
"""What a file is to hold: bytes, or a copy of another file."""


class Outputs:
    """A folder for results."""

    def __init__(self, folder: Path, overwrite: bool) -> None:
        """Refuse a folder that cannot be one.

        Raises:
            InputError: if a file is in its place.
        """
        if folder.exists() and not folder.is_dir():
            raise InputError(f"--output: '{folder}' is a file, expected a folder")
        self._folder = folder
        self._overwrite = overwrite

    def refuse_existing(self, names: Mapping[str, Content]) -> None:
        """Refuse to replace files, unless that was asked for.

        Raises:
            InputError: naming the first that exists.
        """
        for name in names:
            if (self._folder / name).exists() and not self._overwrite:
                raise InputError(f"--output: '{self._folder / name}' exists; choose another --name, or add --overwrite")

    def write(self, files: Mapping[str, Content], console: Console) -> None:
        """Write all files beside each other, then move them to their names; on an error none is left.

        A copy of a checkpoint that is there already, and the same, is left alone.

        Raises:
            InputError: if the folder cannot be written, or a file exists.
        """
        wanted = {name: content for name, content in files.items() if not self._is_there(name, content)}
        self.refuse_existing(wanted)
        if not wanted:
            return
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(prefix=".prepare-", dir=self._folder) as staging:
                for name, content in wanted.items():
                    if isinstance(content, Path):
                        shutil.copyfile(content, Path(staging) / name)
                    else:
                        (Path(staging) / name).write_bytes(content)
                for name in wanted:
                    (Path(staging) / name).replace(self._folder / name)
        except OSError as error:
            raise InputError(f"{self._folder}: cannot be written: {error.strerror or error}") from None
        for name in wanted:
            console.print(f"wrote {self._folder / name}", markup=False)

    def _is_there(self, name: str, content: Content) -> bool:
        target = self._folder / name
        if not isinstance(content, Path) or not target.is_file():
            return False
        return target.samefile(content) or target.read_bytes() == content.read_bytes()


def checkpoint_files(checkpoint: Checkpoint, path: Path) -> dict[str, Content]:
    """Copies of a checkpoint, of its external tensors, and of the contract.yaml that completes it.

    A checkpoint whose contract is complete only where it is, because files beside it take part, is not copied.
    """
    files: dict[str, Content] = {path.name: path}
    external = path.with_name(f"{path.name}.data")
    if external.is_file():
        files[external.name] = external
    if checkpoint.contract_file is not None:
        files[f"{path.stem}.contract.yaml"] = checkpoint.contract_file
    with tempfile.TemporaryDirectory(prefix="prepare-") as folder:
        for name, content in files.items():
            if isinstance(content, Path):
                (Path(folder) / name).symlink_to(content.resolve())
        try:
            read_contract(Path(folder) / path.name)
        except InputError:
            return {}
    return files


def report_bytes(report: MotionReport) -> bytes:
    """The report as a JSON file."""
    return (json.dumps(as_json(report), indent=2) + "\n").encode()
