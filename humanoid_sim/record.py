"""`python -m humanoid_sim.record info|signs|export|dataset`: look into a recording, export it."""

from __future__ import annotations

import csv
import io
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, assert_never

import numpy as np
import tyro
from rich.console import Console

from humanoid_sim.cli import parse, run_program
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.run_figures import RunFigures
from humanoid_sim.evaluation.run_report import describe_spread, print_figures, print_table
from humanoid_sim.files import finite, output_file, whole_file
from humanoid_sim.messages import Event
from humanoid_sim.record_dataset import RecordDataset, record_dataset
from humanoid_sim.recording.reader import Recording, open_recording
from humanoid_sim.robots.description import RobotDescription, load_robot

if TYPE_CHECKING:
    import mujoco

    from humanoid_sim.rendering.poses import Poses


@dataclass(frozen=True)
class Info:
    """Show what happened in a recording, finished or cut off, and what each joint had to do."""

    file: Path
    """Recording (.mcap)."""
    json: bool = False
    """Print everything as JSON."""


@dataclass(frozen=True)
class Signs:
    """Compare the efforts of a robot at rest with what gravity needs: which joint's direction or zero is wrong?

    The robot hung free: feet off the ground, nothing in its hands, nothing touched, some seconds of STANDBY at rest.
    """

    file: Path
    """Recording (.mcap), finished or cut off."""
    robot: str | None = None
    """The robot's YAML file or MJCF, where the recording's own MJCF is not among the shipped robots'."""


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
    robot: Annotated[str | None, tyro.conf.arg(name="robot")] = None
    """The robot's YAML file or MJCF, where the recording's own MJCF is not among the shipped robots'."""
    overwrite: bool = False
    """Replace files that exist."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `record` with command-line arguments; returns the exit status."""
    command: Info | Signs | Export | RecordDataset = parse(
        Info | Signs | Export | Annotated[RecordDataset, tyro.conf.subcommand("dataset")],
        "record",
        arguments,
        positional=True,
    )
    match command:
        case Info():
            _info(command)
        case Signs():
            _signs(command)
        case Export():
            export(command)
        case RecordDataset():
            record_dataset(command)
        case _:
            assert_never(command)
    return 0


def _info(command: Info) -> None:
    recording = open_recording(command.file)
    header = recording.header
    robot = RobotDescription.from_json(header.documents["robot"]) if "robot" in header.documents else None
    figures = RunFigures(robot)
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
    if command.json:
        print(json.dumps(finite(summary), indent=2))
        return
    console = Console(highlight=False)
    overview = [
        ("robot", f"{header.robot}, {len(header.joint_names)} joints"),
        ("started", summary["started"]),
        ("ticks", f"{figures.ticks} at {1.0 / header.control_period:g} Hz, {figures.overruns} overruns"),
        ("missing ticks", str(figures.missing)),
        ("tick time", describe_spread(summary["tick_time"])),
        ("policy steps", str(summary["inferences"])),
        ("file", "complete" if recording.is_complete else f"not complete: {recording.damage}"),
    ]
    print_table(console, summary["file"], overview)
    efforts = [(one["joint"], f"{one['peak']:.1f} of {one['limit']:g}") for one in summary["effort"]]
    print_table(console, "Greatest effort of each joint", efforts, "joint", "N·m")
    print_figures(console, summary)


def _signs(command: Signs) -> None:
    from humanoid_sim.recording.signs import judge_signs  # noqa: PLC0415 - MuJoCo only where it is used

    recording = open_recording(command.file)
    verdicts = judge_signs(recording, _description(recording, command.robot))
    rows = [(row.joint, f"{row.measured:.2f}", f"{row.expected:.2f}", row.verdict) for row in verdicts]
    columns = ("joint", "measured\nN·m", "gravity\nN·m", "verdict")
    print_table(Console(highlight=False), "efforts at rest", rows, *columns)


def export(options: Export) -> None:
    """Write the files. Raises `InputError` if none is named or can be written, or the recording lacks what it takes."""
    writers: dict[str, Callable[[Recording, Path, Export], str]] = {"csv": _csv, "html": _html, "mp4": _mp4}
    chosen = {name: path for name in writers if (path := getattr(options, name)) is not None}
    if not chosen:
        raise InputError("record export: expected --csv, --html or --mp4, each with a file to write")
    for name, path in chosen.items():
        output_file(path, f"--{name}", f".{name}", overwrite=options.overwrite)
    recording = open_recording(options.file)
    for name, path in chosen.items():
        print(f"{path}: {writers[name](recording, path, options)}")


def _csv(recording: Recording, path: Path, options: Export) -> str:
    del options
    columns = recording.columns()
    with whole_file(path) as file:
        text = io.TextIOWrapper(file, encoding="utf-8", newline="")
        table = csv.writer(text, lineterminator="\n")
        table.writerow(columns)
        rows = zip(*(values.tolist() for values in columns.values()), strict=True)
        table.writerows(["" if value != value else value for value in row] for row in rows)  # noqa: PLR0124 - NaN
        text.detach()
    return f"{len(columns['time'])} ticks"


def _html(recording: Recording, path: Path, options: Export) -> str:
    from humanoid_sim.rendering.replay_page import write_page  # noqa: PLC0415 - viser takes seconds to import

    model, poses = _poses(recording, options)
    write_page(path, model, poses, title=recording.header.robot)
    return f"{len(poses.kept)} poses, {poses.kept[-1].time:.1f} s"


def _mp4(recording: Recording, path: Path, options: Export) -> str:
    from humanoid_sim.rendering.pictures import require_pictures  # noqa: PLC0415
    from humanoid_sim.rendering.video import write_video  # noqa: PLC0415

    require_pictures("--mp4")
    model, poses = _poses(recording, options)
    write_video(path, model, poses)
    return f"{len(poses.kept)} frames, {poses.kept[-1].time:.1f} s"


def _poses(recording: Recording, options: Export) -> tuple[mujoco.MjModel, Poses]:
    """Return the robot's model, and the recorded poses; of a run on hardware the joints, and how the base is turned."""
    from humanoid_sim.recording.links import Links  # noqa: PLC0415
    from humanoid_sim.rendering.ghost import ReferenceGhost  # noqa: PLC0415
    from humanoid_sim.rendering.poses import Poses  # noqa: PLC0415
    from humanoid_sim.simulation.model import build_model, joint_addresses  # noqa: PLC0415
    from humanoid_sim.stack import no_policy, recorded_policy  # noqa: PLC0415

    description = _description(recording, options.robot)
    model = build_model(description)
    addresses = joint_addresses(model, description.joint_names).qpos
    links = Links.of(recording.header)
    loaded = recorded_policy(recording.header, no_policy)
    poses = Poses(None if loaded is None else ReferenceGhost(description, loaded.contract, loaded.reference))
    for entry in recording.entries():
        if isinstance(entry, Event):
            continue
        if entry.qpos is not None and len(entry.qpos) == model.nq:
            poses.tick(entry)
        else:
            qpos = model.qpos0.copy()
            qpos[addresses] = np.nan_to_num(entry.input.state.joint_position)
            if links is not None and links.base is not None:
                qpos[:7] = links.poses(entry)[links.base]
            poses.tick(replace(entry, qpos=qpos))
    if not poses.kept:
        raise InputError(f"{recording.path}: holds no ticks: there is nothing to show")
    return model, poses


def _description(recording: Recording, name: str | None) -> RobotDescription:
    """Return the recorded robot, or the named one with its joints, with an MJCF that is there."""
    if name is not None:
        robot = load_robot(name)
    elif "robot" in recording.header.documents:
        robot = RobotDescription.from_json(recording.header.documents["robot"])
    else:
        raise InputError(f"{recording.path}: does not describe its robot; name it with --robot")
    if robot.joint_names != recording.header.joint_names:
        raise InputError(f"--robot: '{robot.name}' has other joints than the robot of {recording.path}")
    if not robot.mjcf_path.is_file():
        raise InputError(f"{recording.path}: its robot's MJCF '{robot.mjcf}' is not here; name the robot with --robot")
    return robot


if __name__ == "__main__":
    sys.exit(run_program(main))
