"""Results of `prepare`: a report of what was found out about the motion, and a folder with all files or none."""

from __future__ import annotations

import hashlib
import json
import math
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from humanoid_sim.errors import InputError, blaming
from humanoid_sim.policy.checkpoint import Checkpoint, read_contract
from humanoid_sim.policy.motion import Motion
from humanoid_sim.policy.onnx_policy import external_file
from humanoid_sim.prepare.acceptance import Findings
from humanoid_sim.prepare.conventions import Conventions
from humanoid_sim.prepare.motion_fit import Tolerance
from humanoid_sim.prepare.source_motion import SourceMotion

Content = bytes | Path
"""Content of a file to be: bytes, or a copy of another file."""


class OutputFolder:
    """A folder for results."""

    def __init__(self, folder: Path, overwrite: bool) -> None:
        """Refuse a folder that cannot be one."""
        if folder.exists() and not folder.is_dir():
            raise InputError(f"--output: '{folder}' is a file, expected a folder")
        self._folder = folder
        self._overwrite = overwrite

    def refuse_existing(self, names: Mapping[str, Content]) -> None:
        """Refuse to replace files, unless that was asked for."""
        for name in names:
            if (self._folder / name).exists() and not self._overwrite:
                raise InputError(f"--output: '{self._folder / name}' exists; choose another --name, or add --overwrite")

    def write(self, files: Mapping[str, Content], console: Console) -> None:
        """Write all files to a temporary folder, then move them to their names; an error leaves none.

        A copy of a checkpoint that is there already, and the same, is left alone.
        """
        wanted = {name: content for name, content in files.items() if not self._is_there(name, content)}
        self.refuse_existing(wanted)
        if not wanted:
            return
        with blaming(f"{self._folder}: cannot be written", OSError):
            self._folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(prefix=".prepare-", dir=self._folder) as staging:
                for name, content in wanted.items():
                    if isinstance(content, Path):
                        shutil.copyfile(content, Path(staging) / name)
                    else:
                        (Path(staging) / name).write_bytes(content)
                for name in wanted:
                    (Path(staging) / name).replace(self._folder / name)
        for name in wanted:
            console.print(f"wrote {self._folder / name}", markup=False)

    def _is_there(self, name: str, content: Content) -> bool:
        target = self._folder / name
        if not isinstance(content, Path) or not target.is_file():
            return False
        return target.samefile(content) or target.read_bytes() == content.read_bytes()


def checkpoint_files(checkpoint: Checkpoint, path: Path) -> dict[str, Content]:
    """Return copies of a checkpoint, of its external tensors, and of the contract.yaml that completes it.

    A checkpoint whose contract needs other files next to it is not copied.
    """
    files: dict[str, Content] = {path.name: path}
    external = external_file(path)
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


@dataclass(frozen=True, slots=True)
class MotionReport:
    """Everything that `prepare` says about a motion."""

    source: SourceMotion
    policy: str
    conventions: Conventions
    tolerance: Tolerance
    found: Findings
    motion: Motion
    bodies_from: str
    """Origin of the poses in the motion file."""
    resampled: bool

    def json_bytes(self) -> bytes:
        """Return the report as a JSON file: lengths in m, angles in rad."""
        source, found, motion = self.source, self.found, self.motion
        file = Path(source.source)
        document = {
            "source": source.source,
            "kind": source.kind,
            "sha256": hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else "",
            "robot": motion.robot,
            "policy": self.policy,
            "source_fps": source.fps,
            "source_frames": source.frame_count,
            "policy_dt": motion.policy_dt,
            "frames": len(motion.frames),
            "resampled": self.resampled,
            "layout": motion.layout,
            "bodies_from": self.bodies_from,
            "conventions": asdict(self.conventions),
            "method": found.method,
            "tolerance": asdict(self.tolerance),
            "bodies": [asdict(body) for body in found.bodies],
            "beyond_limits": found.beyond_limits and asdict(found.beyond_limits),
            "notes": found.notes,
            "verified": bool(found.method),
        }
        return (json.dumps(document, indent=2) + "\n").encode()

    def print(self, console: Console) -> None:
        """Print the table for a person: lengths in mm, angles in degrees."""
        read, source, found, motion = self.conventions, self.source, self.found, self.motion
        columns = Column(style="bold"), Column(overflow="fold")
        table = Table(*columns, title=f"motion {escape(source.source)}", show_header=False, title_justify="left")
        rows = {
            "robot": f"{motion.robot}, policy {self.policy}",
            "source": f"{source.kind}, {source.frame_count} frames at {source.fps:g} per second",
            "motion": f"{len(motion.frames)} frames at {1.0 / motion.policy_dt:g} per second, {motion.duration:.2f} s, "
            f"layout {motion.layout}, poses from {self.bodies_from}" + (", resampled" if self.resampled else ""),
            "joints": _order(read.joint_names, read.joints_said_by),
            "bodies": _order(read.body_names, read.bodies_said_by),
            "quaternions": f"{read.quaternions} ({read.quaternions_said_by})",
            "velocities": "computed from the positions" if source.joint_velocity is None else "the source's",
        }
        for name, text in rows.items():
            table.add_row(name, escape(text))
        console.print(table)
        if found.bodies:
            console.print(_bodies(self))
        for note in found.notes:
            console.print(f"[yellow]note:[/] {escape(note)}")


def _order(names: tuple[str, ...], said_by: str) -> str:
    return f"{len(names)} ({said_by})" if names else "none"


def _bodies(report: MotionReport) -> Table:
    tolerance = report.tolerance
    limits = f"{1e3 * tolerance.position:g} mm, {math.degrees(tolerance.angle):g}°"
    title = f"bodies against {report.found.method}, tolerance {limits}"
    numbers = (Column(heading, justify="right") for heading in ("mm rms", "max", "° rms", "max", "frame"))
    table = Table(Column("body", no_wrap=True), *numbers, title=title, title_justify="left")
    for body in report.found.bodies:
        table.add_row(
            escape(body.name),
            f"{1e3 * body.position_rms:.2f}",
            f"{1e3 * body.position_max:.2f}",
            f"{math.degrees(body.angle_rms):.3f}",
            f"{math.degrees(body.angle_max):.3f}",
            str(body.worst_frame),
            style="red" if body.excess(tolerance) > 1.0 else None,
        )
    return table
