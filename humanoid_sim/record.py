"""`python -m humanoid_sim.record info|signs|export|dataset`: look into a recording, export it."""

from __future__ import annotations

import csv
import io
import json
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, assert_never

import numpy as np
import tyro
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from humanoid_sim.cli import parse, run_program
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.run_figures import describe_effort
from humanoid_sim.files import finite, output_file, whole_file
from humanoid_sim.messages import Event
from humanoid_sim.record_dataset import RecordDataset, record_dataset
from humanoid_sim.recording.reader import Recording, open_recording
from humanoid_sim.recording.summary import Summary, summarize
from humanoid_sim.robots.description import RobotDescription, load_robot

if TYPE_CHECKING:
    import mujoco

    from humanoid_sim.rendering.moments import Moments

_MAX_REMARKS = 40  # lines of a summary's list before it is cut; --json has them all


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
            summary = summarize(open_recording(command.file))
            if command.json:
                print(json.dumps(finite(asdict(summary)), indent=2))
            else:
                _print_summary(Console(highlight=False), summary)
        case Signs():
            _signs(command)
        case Export():
            export(command)
        case RecordDataset():
            record_dataset(command)
        case _:
            assert_never(command)
    return 0


def _print_summary(console: Console, summary: Summary) -> None:
    missing = f", {summary.missing_ticks} missing" if summary.missing_ticks else ""
    overview = {
        "robot": f"{summary.robot}, {summary.joint_count} joints",
        "started": summary.started,
        "duration": f"{summary.last_time - summary.first_time:.2f} s on the robot's clock",
        "ticks": f"{summary.ticks} at {1.0 / summary.control_period:g} Hz, {summary.overruns} overruns{missing}",
        "tick time": f"mean {1e3 * summary.mean_duration:.3f} ms, max {1e3 * summary.max_duration:.3f} ms",
        "policy steps": str(summary.policy_steps),
        "largest joint effort": "-" if summary.effort is None else describe_effort(summary.effort),
        "file": "complete" if summary.complete else f"not complete: {summary.damage}",
    }
    _print_table(console, summary.file, (), overview.items())
    spans = [
        (
            f"{span.start:.2f} s",
            f"{span.ticks * summary.control_period:.2f} s",
            span.mode.name,
            span.controller,
            span.reason,
        )
        for span in summary.timeline
    ]
    _print_table(console, "modes", ("from", "for", "mode", "controller", "why"), spans)
    joints = [
        (row["joint"], f"{row['speed']:.2f}", _of(row["effort"], row["effort_limit"]), _range(row))
        for row in summary.joints
    ]
    _print_table(console, "joints, the greatest of each", ("joint", "rad/s", "N·m", "rad"), joints)
    remarks = [(f"{remark.time:.2f} s", remark.kind, remark.text) for remark in summary.remarks[:_MAX_REMARKS]]
    if len(summary.remarks) > _MAX_REMARKS:
        remarks.append(("", "", f"and {len(summary.remarks) - _MAX_REMARKS} more (--json lists all)"))
    _print_table(console, "events, faults, refusals", ("at", "what", ""), remarks)


def _of(effort: float, limit: float | None) -> str:
    return f"{effort:.1f}" if limit is None else f"{effort:.1f} of {limit:g}"


def _range(row: dict[str, float | None]) -> str:
    return "-" if row["lowest"] is None else f"{row['lowest']:.2f} to {row['highest']:.2f}"


def _print_table(console: Console, title: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    table = Table(*columns, title=escape(title), title_justify="left", show_header=bool(columns))
    for row in rows:
        table.add_row(*(escape(value) for value in row))
    if table.row_count:
        console.print(table)


def _signs(command: Signs) -> None:
    from humanoid_sim.recording.signs import judge_signs  # noqa: PLC0415 - MuJoCo only where it is used

    recording = open_recording(command.file)
    verdicts = judge_signs(recording, _description(recording, command.robot))
    rows = [(row.joint, f"{row.measured:.2f}", f"{row.expected:.2f}", row.verdict) for row in verdicts]
    columns = ("joint", "measured\nN·m", "gravity\nN·m", "verdict")
    _print_table(Console(highlight=False), "efforts at rest", columns, rows)


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

    model, moments = _moments(recording, options)
    write_page(path, model, moments, title=recording.header.robot)
    return f"{len(moments.kept)} poses, {moments.kept[-1].time:.1f} s"


def _mp4(recording: Recording, path: Path, options: Export) -> str:
    from humanoid_sim.rendering.backend import require_pictures  # noqa: PLC0415
    from humanoid_sim.rendering.video import write_video  # noqa: PLC0415

    require_pictures("--mp4")
    model, moments = _moments(recording, options)
    write_video(path, model, moments)
    return f"{len(moments.kept)} frames, {moments.kept[-1].time:.1f} s"


def _moments(recording: Recording, options: Export) -> tuple[mujoco.MjModel, Moments]:
    """Return the robot's model, and the recorded poses; of a run on hardware the joints, and how the base is turned."""
    from humanoid_sim.recording.body import RecordedBody  # noqa: PLC0415
    from humanoid_sim.rendering.ghost import ReferenceGhost  # noqa: PLC0415
    from humanoid_sim.rendering.moments import Moments  # noqa: PLC0415
    from humanoid_sim.simulation.model import build_model, joint_addresses  # noqa: PLC0415
    from humanoid_sim.stack import no_policy, recorded_policy  # noqa: PLC0415

    description = _description(recording, options.robot)
    model = build_model(description)
    addresses = joint_addresses(model, description.joint_names).qpos
    body = RecordedBody.of(recording.header)
    loaded = recorded_policy(recording.header, no_policy)
    moments = Moments(None if loaded is None else ReferenceGhost.of(description, loaded.contract, loaded.reference))
    for entry in recording.entries():
        if isinstance(entry, Event):
            moments.event(entry)
        elif entry.qpos is not None and len(entry.qpos) == model.nq:
            moments.tick(entry)
        else:
            qpos = model.qpos0.copy()
            qpos[addresses] = np.nan_to_num(entry.input.state.joint_position)
            if body is not None and description.is_floating:
                qpos[:7] = body.poses(entry)[len(body.hinged)]
            moments.tick(replace(entry, qpos=qpos))
    if not moments.kept:
        raise InputError(f"{recording.path}: holds no ticks: there is nothing to show")
    return model, moments


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
