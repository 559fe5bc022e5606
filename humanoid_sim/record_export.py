"""`record export`: a recording as a URDF, a table, a video, or for the rerun viewer."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import tyro

from humanoid_sim.errors import InputError

if TYPE_CHECKING:
    from humanoid_sim.recording.body import RecordedBody
    from humanoid_sim.recording.reader import Recording
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
    mp4: Path | None = None
    """A video (.mp4)."""
    rerun: Path | None = None
    """For the rerun viewer (.rrd): the robot and its plots. Needs the extra 'rerun'."""
    robot: Annotated[str | None, tyro.conf.arg(name="robot")] = None
    """The robot's YAML file or MJCF, where the recording's own MJCF is not among the shipped robots'."""
    overwrite: bool = False
    """Replace files that exist."""

    EXAMPLES: ClassVar[tuple[tuple[str, str], ...]] = (
        ("runs/run.mcap --csv run.csv --mp4 run.mp4", "a table and a video"),
    )


def export(options: Export) -> int:
    """Write the files; returns the exit status.

    Raises:
        InputError: nothing is asked for, a file cannot be written, or the recording lacks what it takes.
    """
    from humanoid_sim.files import output_file  # noqa: PLC0415 - heavy imports stay out of `--help`
    from humanoid_sim.recording.reader import open_recording  # noqa: PLC0415

    writers: dict[str, Callable[[Recording, Path, Export], str]] = {
        "urdf": _urdf,
        "csv": _csv,
        "mp4": _mp4,
        "rerun": _rerun,
    }
    suffixes = {"rerun": ".rrd"}
    chosen = {name: path for name in writers if (path := getattr(options, name)) is not None}
    if not chosen:
        raise InputError("record export: expected --urdf, --csv, --mp4 or --rerun, each with a file to write")
    for name, path in chosen.items():
        output_file(path, f"--{name}", suffixes.get(name, f".{name}"), overwrite=options.overwrite)
    recording = open_recording(options.file).of_last_policy()
    for name, path in chosen.items():
        print(f"{path}: {writers[name](recording, path, options)}")
    return 0


def _urdf(recording: Recording, path: Path, options: Export) -> str:
    from humanoid_sim.files import whole_file  # noqa: PLC0415

    body = _body(recording, options)
    with whole_file(path) as file:
        file.write(body.urdf.encode())
    return f"{len(body.joints)} joints"


def _csv(recording: Recording, path: Path, options: Export) -> str:
    from humanoid_sim.files import whole_file  # noqa: PLC0415
    from humanoid_sim.recording.columns import column_names, rows  # noqa: PLC0415

    del options
    count = 0
    with whole_file(path) as file:
        text = io.TextIOWrapper(file, encoding="utf-8", newline="")
        table = csv.writer(text, lineterminator="\n")
        table.writerow(column_names(recording))
        for row in rows(recording):
            table.writerow(row)
            count += 1
        text.flush()
        text.detach()
    return f"{count} ticks"


def _mp4(recording: Recording, path: Path, options: Export) -> str:
    from rich.console import Console  # noqa: PLC0415

    from humanoid_sim.rendering.video import VideoSink, finish_video  # noqa: PLC0415
    from humanoid_sim.simulation.model import build_model, joint_addresses  # noqa: PLC0415

    description = _description(recording, options)
    model = build_model(description)
    addresses = joint_addresses(model, description.joint_names).qpos
    body = _body(recording, options)
    base = [joint for joint in body.floating if joint.parent == "world"]
    video = VideoSink(path, lambda: model)
    try:
        for tick in recording.ticks():
            if tick.qpos is not None and len(tick.qpos) == model.nq:
                video.tick(tick)
                continue
            qpos = model.qpos0.copy()  # on hardware: the joints, and how the base is turned
            measured = tick.input.state.joint_position
            qpos[addresses] = [value if math.isfinite(value) else 0.0 for value in measured]
            for joint, pose in zip(body.floating, body.floating_poses(tick), strict=True):
                if joint in base:
                    qpos[joint.qpos : joint.qpos + 7] = pose
            video.tick(replace(tick, qpos=qpos))
        report = finish_video(video, Console(stderr=True, highlight=False), "Ctrl-C leaves no file")
    except BaseException:
        video.abandon()
        raise
    return f"{report.frame_count} frames, {report.duration:.1f} s"


def _rerun(recording: Recording, path: Path, options: Export) -> str:
    import tempfile  # noqa: PLC0415

    from humanoid_sim.recording.columns import action_names  # noqa: PLC0415
    from humanoid_sim.rendering.rerun_log import RerunLog, rerun_module  # noqa: PLC0415

    library = rerun_module("record export --rerun")
    body = _body(recording, options)
    with tempfile.TemporaryDirectory(dir=path.absolute().parent, prefix=".rerun-") as folder:
        made = Path(folder, "run.rrd")
        stream = library.RecordingStream("humanoid_sim")
        stream.save(str(made))
        log = RerunLog(library, stream, recording.header, body, action_names(recording))
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
        documents |= body_documents(_description(recording, options))
    try:
        body = RecordedBody.of(recording.header, documents)
    except BodyError as error:
        raise InputError(f"{recording.path}: its robot's body cannot be used: {error}") from None
    if body is None:
        raise InputError(f"{recording.path}: does not describe its robot's body; name the robot with --robot")
    return body


def _description(recording: Recording, options: Export) -> RobotDescription:
    """Return the recorded robot, with an MJCF that is there."""
    from humanoid_sim.robots.description import RobotDescription, load_robot  # noqa: PLC0415

    if options.robot is not None:
        robot = load_robot(options.robot)
    elif "robot" in recording.header.documents:
        robot = RobotDescription.from_json(recording.header.documents["robot"])
    else:
        raise InputError(f"{recording.path}: does not describe its robot; name it with --robot")
    if robot.joint_names != recording.header.joint_names:
        raise InputError(f"--robot: '{robot.name}' has other joints than the robot of {recording.path}")
    if not robot.mjcf_path.is_file():
        raise InputError(f"{recording.path}: its robot's MJCF '{robot.mjcf}' is not here; name the robot with --robot")
    return robot
