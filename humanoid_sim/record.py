"""`python -m humanoid_sim.record info|signs|export|dataset`: look into a recording, export it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console

from humanoid_sim.cli import parse, run_program
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.evaluation.run_figures import MotionFigures, RunFigures
from humanoid_sim.evaluation.run_report import describe_spread, print_figures, print_table
from humanoid_sim.files import json_text, output_file, whole_file
from humanoid_sim.messages import Event
from humanoid_sim.record_dataset import RecordDataset
from humanoid_sim.recording.links import Links
from humanoid_sim.recording.reader import Recording, open_recording
from humanoid_sim.recording.signs import judge_signs
from humanoid_sim.rendering.ghost import ReferenceGhost
from humanoid_sim.rendering.poses import Poses
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.simulation.model import build_model, joint_addresses
from humanoid_sim.stack import no_policy, recorded_contracts, recorded_policy


@dataclass(frozen=True)
class Info:
    """Show what happened in a recording, finished or cut off: modes, efforts, errors from its motion or song."""

    file: Path
    """Recording (.mcap)."""
    json: bool = False
    """Print everything as JSON."""

    def run(self) -> None:
        recording = open_recording(self.file)
        header = recording.header
        with blaming(f"{recording.path}: its header lacks the robot", KeyError):
            robot = RobotDescription.from_json(header.documents["robot"])
        loaded = recorded_policy(header, no_policy) if len(recorded_contracts(header)) == 1 else None
        with blaming(recording.path):
            figures = RunFigures(robot, motion=None if loaded is None else MotionFigures(robot, loaded))
            for entry in recording.entries():
                if isinstance(entry, Event):
                    figures.event(entry)
                else:
                    figures.tick(entry)
        summary = {
            "file": str(recording.path),
            "robot": header.robot,
            "started": datetime.fromtimestamp(header.start_time_ns // 10**9, UTC).isoformat(),
            "control_period": header.control_period,
            "ticks": figures.ticks,
            "missing_ticks": figures.missing,
            "overruns": figures.overruns,
            "damage": recording.damage,
            **figures.summary(),
        }
        if self.json:
            print(json_text(summary))
            return
        console = Console(highlight=False)
        rate, lost = 1.0 / header.control_period, f"{figures.overruns} overruns, {figures.missing} missing"
        overview = [
            ("robot", f"{header.robot}, {len(header.joint_names)} joints"),
            ("started", summary["started"]),
            ("ticks", f"{figures.ticks} at {rate:g} Hz, {lost}"),
            ("tick time", describe_spread(summary["tick_time"])),
            ("policy steps", str(summary["inferences"])),
            ("file", "complete" if recording.is_complete else f"not complete: {recording.damage}"),
        ]
        print_table(console, summary["file"], overview)
        efforts = [(one["joint"], f"{one['peak']:.1f} of {one['limit']:g}") for one in summary["effort"]]
        print_table(console, "Greatest effort of each joint", efforts, "joint", "N·m")
        print_figures(console, summary)


@dataclass(frozen=True)
class Signs:
    """Compare the efforts of a robot that hung free in STANDBY with gravity: which joint's direction is wrong?"""

    file: Path
    """Recording (.mcap), finished or cut off."""
    robot: str | None = None
    """The robot's YAML file or MJCF, where the recording's own MJCF is not among the shipped robots'."""

    def run(self) -> None:
        recording = open_recording(self.file)
        verdicts = judge_signs(recording, _description(recording, self.robot))
        rows = [(row.joint, f"{row.measured:.2f}", f"{row.expected:.2f}", row.verdict) for row in verdicts]
        columns = ("joint", "measured\nN·m", "gravity\nN·m", "verdict")
        print_table(Console(highlight=False), "efforts at rest", rows, *columns)


@dataclass(frozen=True)
class Export:
    """Write what a recording holds for other programs; any of the options, each with the file to write."""

    file: Path
    """Recording (.mcap), finished or cut off."""
    csv: Path | None = None
    """A row per tick: time, mode, joint states, commands, IMU, the policy's action (.csv)."""
    html: Path | None = None
    """A page that replays the run in 3D in any browser (.html)."""
    mp4: Path | None = None
    """A video (.mp4); needs OpenGL."""
    robot: str | None = None
    """The robot's YAML file or MJCF, where the recording's own MJCF is not among the shipped robots'."""
    overwrite: bool = False
    """Replace files that exist."""

    def run(self) -> None:
        chosen = {"csv": self.csv, "html": self.html, "mp4": self.mp4}
        outputs = {name: path for name, path in chosen.items() if path is not None}
        if not outputs:
            raise InputError("record export: expected --csv, --html or --mp4, each with a file to write")
        for name, path in outputs.items():
            output_file(path, f"--{name}", f".{name}", overwrite=self.overwrite)
        recording = open_recording(self.file)
        if self.csv is not None:
            columns = recording.columns()
            with whole_file(self.csv) as file:
                table = np.column_stack(list(columns.values()))
                np.savetxt(file, table, fmt="%.17g", delimiter=",", header=",".join(columns), comments="")
        if self.html is not None or self.mp4 is not None:
            self._show(recording)
        print("wrote", *outputs.values())

    def _show(self, recording: Recording) -> None:
        """Write page and video of the recorded poses; of a run on hardware the joints, and how the base is rotated."""
        from humanoid_sim.rendering.pictures import require_pictures  # noqa: PLC0415 - viser takes seconds to import
        from humanoid_sim.rendering.replay_page import write_page  # noqa: PLC0415
        from humanoid_sim.rendering.video import write_video  # noqa: PLC0415

        if self.mp4 is not None:
            require_pictures("--mp4")
        description = _description(recording, self.robot)
        model = build_model(description)
        addresses = joint_addresses(model, description.joint_names).qpos
        links = Links.of(recording.header)
        loaded = recorded_policy(recording.header, no_policy)
        poses = Poses(None if loaded is None else ReferenceGhost(description, loaded.contract, loaded.reference))
        for tick in recording.ticks():
            qpos = tick.qpos
            if qpos is None or len(qpos) != model.nq:
                qpos = model.qpos0.copy()
                qpos[addresses] = np.nan_to_num(tick.input.state.joint_position)
                if links is not None and links.base is not None:
                    qpos[:7] = links.poses(tick)[links.base]
            poses.tick(replace(tick, qpos=qpos))
        if not poses.kept:
            raise InputError(f"{recording.path}: holds no ticks: there is nothing to show")
        if self.html is not None:
            write_page(self.html, model, poses, title=recording.header.robot)
        if self.mp4 is not None:
            write_video(self.mp4, model, poses)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `record` with command-line arguments; returns the exit status."""
    command: Info | Signs | Export | RecordDataset = parse(
        Info | Signs | Export | Annotated[RecordDataset, tyro.conf.subcommand("dataset")],
        "record",
        arguments,
        positional=True,
    )
    command.run()
    return 0


def _description(recording: Recording, name: str | None) -> RobotDescription:
    """Return the recorded robot, or the named one with its joints, with an MJCF that is there."""
    recorded = recording.header.documents.get("robot", "{}")
    robot = RobotDescription.from_json(recorded) if name is None else load_robot(name)
    if robot.joint_names != recording.header.joint_names:
        raise InputError(f"--robot: '{robot.name}' has other joints than the robot of {recording.path}")
    if not robot.mjcf_path.is_file():
        raise InputError(f"{recording.path}: its robot's MJCF '{robot.mjcf}' is not here; name the robot with --robot")
    return robot


if __name__ == "__main__":
    sys.exit(run_program(main))
