"""`python -m humanoid_sim.record info|signs|export|dataset`: look into a recording, export it."""

from __future__ import annotations

import csv
import io
import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, assert_never

import tyro
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from humanoid_sim.cli import parse, run_program
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.evaluation.run_figures import JointUse, describe_effort
from humanoid_sim.files import output_file, whole_file
from humanoid_sim.messages import Event
from humanoid_sim.record_dataset import RecordDataset, record_dataset
from humanoid_sim.recording.reader import Recording, open_recording, recorded_settings
from humanoid_sim.recording.summary import Summary, summarize

if TYPE_CHECKING:
    import mujoco

    from humanoid_sim.recording.body import RecordedBody
    from humanoid_sim.rendering.moments import Moments
    from humanoid_sim.robots.description import RobotDescription


@dataclass(frozen=True)
class Export:
    """Write what a recording holds for other programs; any of the options, each with the file to write."""

    file: Path
    """Recording (.mcap), finished or cut off."""
    urdf: Path | None = None
    """The robot, with primitive geometry (.urdf)."""
    csv: Path | None = None
    """A row per tick: time, mode, joint states, commands, IMU, the policy's frame and action (.csv)."""
    html: Path | None = None
    """A page that replays the run in 3D in any browser (.html)."""
    mp4: Path | None = None
    """A video (.mp4); needs OpenGL."""
    rerun: Path | None = None
    """For the rerun viewer (.rrd): the robot and its plots. Needs the extra 'rerun'."""
    robot: Annotated[str | None, tyro.conf.arg(name="robot")] = None
    """The robot's YAML file or MJCF, where the recording's own MJCF is not among the shipped robots'."""
    overwrite: bool = False
    """Replace files that exist."""


def export(options: Export) -> int:
    """Write the files; returns the exit status.

    Raises `InputError` if nothing is asked for, a file cannot be written, or the recording lacks what it takes.
    """
    writers: dict[str, Callable[[Recording, Path, Export], str]] = {
        "urdf": _urdf,
        "csv": _csv,
        "html": _html,
        "mp4": _mp4,
        "rerun": _rerun,
    }
    suffixes = {"rerun": ".rrd"}
    chosen = {name: path for name in writers if (path := getattr(options, name)) is not None}
    if not chosen:
        raise InputError("record export: expected --urdf, --csv, --html, --mp4 or --rerun, each with a file to write")
    for name, path in chosen.items():
        output_file(path, f"--{name}", suffixes.get(name, f".{name}"), overwrite=options.overwrite)
    recording = open_recording(options.file)
    for name, path in chosen.items():
        print(f"{path}: {writers[name](recording, path, options)}")
    return 0


def _urdf(recording: Recording, path: Path, options: Export) -> str:
    body = _body(recording, options)
    with whole_file(path) as file:
        file.write(body.urdf.encode())
    return f"{len(body.joints)} joints"


def _csv(recording: Recording, path: Path, options: Export) -> str:
    del options
    count = 0
    with whole_file(path) as file:
        text = io.TextIOWrapper(file, encoding="utf-8", newline="")
        table = csv.writer(text, lineterminator="\n")
        table.writerow(recording.column_names())
        for row in recording.rows():
            table.writerow(row)
            count += 1
        text.flush()
        text.detach()
    return f"{count} ticks"


def _html(recording: Recording, path: Path, options: Export) -> str:
    from humanoid_sim.rendering.moments import pose_progress  # noqa: PLC0415
    from humanoid_sim.rendering.replay_page import write_page  # noqa: PLC0415 - viser takes seconds to import

    model, moments = _moments(recording, options)
    policy = recorded_settings(recording.path, recording.header).get("policy")
    title = ", ".join(filter(None, (recording.header.robot, policy and Path(policy).stem)))
    with pose_progress(Console(stderr=True, highlight=False), "writing the page") as progress:
        write_page(path, model, moments, title=title, progress=progress)
    return f"{len(moments.kept)} poses, {moments.kept[-1].time:.1f} s"


def _mp4(recording: Recording, path: Path, options: Export) -> str:
    from humanoid_sim.rendering.backend import require_pictures  # noqa: PLC0415
    from humanoid_sim.rendering.moments import pose_progress  # noqa: PLC0415
    from humanoid_sim.rendering.video import write_video  # noqa: PLC0415

    require_pictures("--mp4")
    model, moments = _moments(recording, options)
    with pose_progress(Console(stderr=True, highlight=False), "drawing the video") as progress:
        write_video(path, model, moments, progress=progress)
    return f"{len(moments.kept)} frames, {moments.kept[-1].time:.1f} s"


def _moments(recording: Recording, options: Export) -> tuple[mujoco.MjModel, Moments]:
    """Return the robot's model, and the recorded poses; of a run on hardware the joints, and how the base is turned."""
    from humanoid_sim.rendering.ghost import ReferenceGhost  # noqa: PLC0415
    from humanoid_sim.rendering.moments import Moments  # noqa: PLC0415
    from humanoid_sim.simulation.model import build_model, joint_addresses  # noqa: PLC0415
    from humanoid_sim.stack import no_policy, recorded_policy  # noqa: PLC0415

    description = _description(recording, options.robot)
    model = build_model(description)
    addresses = joint_addresses(model, description.joint_names).qpos
    body = _body(recording, options)
    base = [joint for joint in body.floating if joint.parent == "world"]
    loaded = recorded_policy(recording.header, no_policy)
    moments = Moments(None if loaded is None else ReferenceGhost.of(description, loaded.contract, loaded.reference))
    for entry in recording.entries():
        if isinstance(entry, Event):
            moments.event(entry)
    for tick in recording.ticks():
        if tick.qpos is not None and len(tick.qpos) == model.nq:
            moments.tick(tick)
            continue
        qpos = model.qpos0.copy()
        measured = tick.input.state.joint_position
        qpos[addresses] = [value if math.isfinite(value) else 0.0 for value in measured]
        for joint, pose in zip(body.floating, body.floating_poses(tick), strict=True):
            if joint in base:
                qpos[joint.qpos : joint.qpos + 7] = pose
        moments.tick(replace(tick, qpos=qpos))
    if not moments.kept:
        raise InputError(f"{recording.path}: holds no ticks: there is nothing to show")
    return model, moments


def _rerun(recording: Recording, path: Path, options: Export) -> str:
    import tempfile  # noqa: PLC0415

    from humanoid_sim.rendering.rerun_log import RerunLog, rerun_module  # noqa: PLC0415

    library = rerun_module("record export --rerun")
    body = _body(recording, options)
    with tempfile.TemporaryDirectory(dir=path.absolute().parent, prefix=".rerun-") as folder:
        made = Path(folder, "run.rrd")
        stream = library.RecordingStream("humanoid_sim")
        stream.save(str(made))
        log = RerunLog(library, stream, recording.header, body, recording.action_names())
        for tick in recording.ticks():
            log.tick(tick)
        stream.flush()
        stream.disconnect()
        made.replace(path)
    return f"{log.count} poses"


def _body(recording: Recording, options: Export) -> RecordedBody:
    from humanoid_sim.recording.body import BodyError, RecordedBody  # noqa: PLC0415
    from humanoid_sim.robots.urdf import body_documents  # noqa: PLC0415

    documents = dict(recording.header.documents)
    if options.robot is not None:
        documents |= body_documents(_description(recording, options.robot))
    with blaming(f"{recording.path}: its robot's body cannot be used", BodyError):
        body = RecordedBody.of(recording.header, documents)
    if body is None:
        raise InputError(f"{recording.path}: does not describe its robot's body; name the robot with --robot")
    return body


def _description(recording: Recording, name: str | None) -> RobotDescription:
    """Return the recorded robot, or the named one with its joints, with an MJCF that is there."""
    from humanoid_sim.robots.description import RobotDescription, load_robot  # noqa: PLC0415

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


_MAX_REMARKS = 40
"""Lines of a summary's list before it is cut; --json has them all."""


@dataclass(frozen=True)
class Info:
    """Show what happened in a recording, finished or cut off."""

    file: Path
    """Recording (.mcap)."""
    json: bool = False
    """Print everything as JSON."""
    joints: bool = False
    """Show only, joint by joint, the greatest speed, the greatest effort and its limit, and the share of the range."""


@dataclass(frozen=True)
class Signs:
    """Compare the efforts of a robot at rest with what gravity needs: which joint's direction or zero is wrong?

    The robot hung free: feet off the ground, nothing in its hands, nothing touched, some seconds of STANDBY at rest.
    """

    file: Path
    """Recording (.mcap), finished or cut off."""
    robot: str | None = None
    """The robot's YAML file or MJCF, where the recording's own MJCF is not among the shipped robots'."""


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
            return export(command)
        case RecordDataset():
            return record_dataset(command)
        case _:
            assert_never(command)
    return 0


def _info(command: Info) -> None:
    summary = summarize(open_recording(command.file))
    if command.json:
        print(json.dumps(summary.as_json(), indent=2))
    elif command.joints:
        if summary.joints is None:
            raise InputError(f"{command.file}: --joints: its header does not describe the robot and its limits")
        Console(highlight=False).print(_joints(summary.joints))
    else:
        _print_summary(Console(highlight=False), summary)


def _signs(command: Signs) -> None:
    from humanoid_sim.recording.signs import judge_signs  # noqa: PLC0415 - MuJoCo only where it is used

    recording = open_recording(command.file)
    rows = judge_signs(recording, _description(recording, command.robot))
    efforts = ("measured\nN·m", "gravity\nN·m")
    table = Table("joint", *efforts, "verdict", title="efforts at rest", title_justify="left")
    for row in rows:
        table.add_row(escape(row.joint), f"{row.measured:.2f}", f"{row.expected:.2f}", escape(row.verdict))
    Console(highlight=False).print(table)


def _print_summary(console: Console, summary: Summary) -> None:
    console.print(_overview(summary))
    console.print(_timeline(summary))
    if summary.remarks:
        console.print(_remarks(summary))
    console.print(_topics(summary))


def _overview(summary: Summary) -> Table:
    recording, header = summary.recording, summary.recording.header
    table = Table(title=escape(str(recording.path)), show_header=False, title_justify="left")
    rows = {
        "robot": f"{header.robot}, {len(header.joint_names)} joints",
        "started": summary.started,
        "duration": f"{summary.duration:.2f} s on the robot's clock",
        "ticks": f"{summary.ticks} at {1.0 / header.control_period:g} Hz, {summary.overruns} overruns",
        "tick time": f"mean {1e3 * summary.mean_duration:.3f} ms, max {1e3 * summary.max_duration:.3f} ms",
        "policy steps": str(summary.policy_steps),
        "largest joint effort": "-" if summary.joints is None else describe_effort(summary.joints.effort()),
        "size": f"{recording.size / 1e6:.2f} MB",
        "file": "complete" if recording.is_complete else f"not complete: {recording.damage}",
        "definitions": _definitions(header.documents),
        "documents": ", ".join(f"{name} ({len(text)} B)" for name, text in header.documents.items()) or "none",
        "attachments": ", ".join(f"{name} ({len(data)} B)" for name, data in header.attachments.items()) or "none",
    }
    if summary.missing:
        rows["missing"] = f"[red]{summary.missing} ticks are not in the recording"
    for name, text in rows.items():
        table.add_row(name, text if name == "missing" else escape(text))
    return table


def _definitions(documents: Mapping[str, str]) -> str:
    """Return whether what judged the run, if anything did, meant by a fall and by an error what is meant today."""
    from humanoid_sim.evaluation.failure import DEFINITIONS, differing  # noqa: PLC0415 - brings MuJoCo

    try:
        recorded = json.loads(documents["settings"])["definitions"]
    except (KeyError, TypeError, ValueError):
        return "not recorded"
    others = differing(recorded) if isinstance(recorded, dict) else ()
    return f"others than today's: {', '.join(others)}" if others else "today's, of " + ", ".join(DEFINITIONS)


def _timeline(summary: Summary) -> Table:
    table = Table("from", "for", "mode", "controller", "why", title="modes", title_justify="left")
    for span in summary.timeline:
        seconds = span.ticks * summary.recording.header.control_period
        texts = (span.mode.name, escape(span.controller), escape(span.reason))
        table.add_row(f"{span.start:.2f} s", f"{seconds:.2f} s", *texts)
    return table


def _joints(joints: JointUse) -> Table:
    """From the joint that used most of its limit on; where no limit is known, in the robot's order."""
    figures = ("speed\nrad/s", "effort\nN·m", "of its\nlimit", "reached\nrad", "of its\nrange")
    table = Table("joint", *figures, title="joints, the greatest of each", title_justify="left")
    table.columns[0].no_wrap = True
    table.box, table.padding = box.SIMPLE_HEAD, (0, 1, 0, 0)  # all columns within 80 characters
    table.caption, table.caption_justify = escape(describe_effort(joints.effort())), "left"
    rows = joints.rows()
    for row in sorted(rows, key=lambda row: -(row["effort"] / row["effort_limit"] if row["effort_limit"] else 0.0)):
        limit, ends = row["effort_limit"], [row[name] for name in ("lowest", "highest", "lower", "upper")]
        share = None if None in ends or ends[3] <= ends[2] else (ends[1] - ends[0]) / (ends[3] - ends[2])
        table.add_row(
            escape(row["joint"]),
            f"{row['speed']:.2f}",
            f"{row['effort']:.1f}",
            "unknown" if limit is None else f"{100.0 * row['effort'] / limit:.0f} % of {limit:g}",
            "-" if row["lowest"] is None else f"{row['lowest']:.2f} to {row['highest']:.2f}",
            "-" if share is None else f"{100.0 * share:.0f} %",
        )
    return table


def _remarks(summary: Summary) -> Table:
    table = Table("at", "what", "", title="events, faults, refusals", title_justify="left")
    for remark in summary.remarks[:_MAX_REMARKS]:
        table.add_row(f"{remark.time:.2f} s", remark.kind, escape(remark.text))
    left = len(summary.remarks) - _MAX_REMARKS
    if left > 0:
        table.add_row("", "", f"and {left} more (--json lists all)")
    return table


def _topics(summary: Summary) -> Table:
    table = Table("topic", "messages", "type", title="topics", title_justify="left")
    for name, topic in sorted(summary.topics.items()):
        table.add_row(escape(name), str(topic.messages), escape(topic.schema))
    return table


if __name__ == "__main__":
    sys.exit(run_program(main))
