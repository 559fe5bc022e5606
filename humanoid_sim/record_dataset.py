"""`python -m humanoid_sim.record dataset`: recordings become a LeRobot dataset (format v3.0)."""

from __future__ import annotations

import importlib
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from humanoid_sim.errors import InputError, needing

if TYPE_CHECKING:
    from humanoid_sim.policy.motion import Motion
    from humanoid_sim.recording.episodes import Episode
    from humanoid_sim.recording.reader import Recording

_IMU = ("quaternion.w", "quaternion.x", "quaternion.y", "quaternion.z",
        "gyro.x", "gyro.y", "gyro.z", "acceleration.x", "acceleration.y", "acceleration.z")  # fmt: skip


@dataclass(frozen=True)
class RecordDataset:
    """Make a LeRobot dataset of recordings: one episode for each stretch under a policy or a remote.

    A frame holds `observation.state` (joint positions, rad), `observation.velocity`, `observation.effort`,
    `observation.imu` and `action` (commanded joint positions, rad), in the order of the robot's joints.
    """

    recordings: tuple[Path, ...]
    """Recordings (.mcap) of one robot."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("dataset")
    """Folder of the dataset; it must not exist."""
    repo_id: str | None = None
    """Its id, should it go to a hub, user/name. Default: local/<name of the folder>."""
    task: str | None = None
    """The robot's task, in words. Default: made from the motion's or the policy's name."""
    modes: tuple[Literal["locomotion", "remote"], ...] = ("locomotion", "remote")
    """Modes from which to take episodes."""
    fps: int | None = None
    """Frames per second; must divide the control rate. Default: the policy's steps, 50 where there are none."""
    reference: bool = False
    """Add the reference motion that the policy was shown, as features reference.*."""


def record_dataset(config: RecordDataset) -> int:
    """Write the dataset; returns the exit status. Raises `InputError` if it cannot be made."""
    from humanoid_sim.recording.reader import open_recording  # noqa: PLC0415

    if config.output.exists():
        raise InputError(f"--output: '{config.output}' exists; a dataset is only written whole, to a new folder")
    if not config.output.resolve().parent.is_dir():
        raise InputError(f"--output: the folder '{config.output.resolve().parent}' does not exist")
    if config.fps is not None and config.fps < 1:
        raise InputError(f"--fps: is {config.fps}, expected at least 1")
    repo_id = config.repo_id or f"local/{config.output.resolve().name}"
    if repo_id.count("/") != 1:
        raise InputError(f"--repo-id: is '{repo_id}', expected user/name")
    if not config.recordings:
        raise InputError("no recording is given, expected at least one .mcap")
    recordings = [open_recording(path) for path in config.recordings]
    first = recordings[0].header
    for recording in recordings[1:]:
        if recording.header.joint_names != first.joint_names or recording.header.robot != first.robot:
            raise InputError(
                f"{recording.path}: is of robot '{recording.header.robot}', {recordings[0].path} of '{first.robot}'; "
                "a dataset holds one robot with one order of joints"
            )
    library = _import_lerobot()
    staging = config.output.resolve().with_name(f".{config.output.resolve().name}.{os.getpid()}.tmp")
    try:
        counts = _write(library, staging, repo_id, recordings, config)
        _check_loads(library, staging, repo_id, counts)
        staging.rename(config.output)
    except OSError as error:
        raise InputError(f"{config.output}: cannot be written: {error.strerror or error}") from None
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    print(f"{config.output}: {len(counts)} episodes, {sum(counts)} frames, as {repo_id}")
    return 0


def _import_lerobot() -> Any:
    """Return the module of LeRobot's datasets, which does not ask the hub for what a local one lacks."""
    os.environ.setdefault("HF_HUB_OFFLINE", "1")  # read when the hub's package is imported
    with needing("lerobot", "lerobot", "record dataset"):
        return importlib.import_module("lerobot.datasets.lerobot_dataset")


def _write(library: Any, root: Path, repo_id: str, recordings: list[Recording], config: RecordDataset) -> list[int]:
    """Write everything below `root`; returns the number of frames of each episode.

    Raises `InputError` if there is no episode, or two have different frame rates.
    """
    counts: list[int] = []
    dataset, rate = None, 0.0
    for recording, episode in _episodes(recordings, config):
        motion = _motion(recording) if config.reference else None
        if dataset is None:
            rate = episode.fps
            if abs(rate - round(rate)) > 1e-6:
                raise InputError(f"{recording.path}: {rate:g} frames per second is not a whole number; choose --fps")
            features = _features(recording, motion)
            dataset = library.LeRobotDataset.create(
                repo_id, round(rate), features, root=root, robot_type=recording.header.robot, use_videos=False
            )
        if abs(episode.fps - rate) > 1e-6 * rate:
            raise InputError(
                f"{recording.path}: its policy takes {episode.fps:g} steps per second, the first {rate:g}; choose --fps"
            )
        for frame in _frames(episode, motion, recording):
            if set(frame) != set(features):
                raise InputError(
                    f"{recording.path}: its reference motion has other features than the first recording's"
                )
            dataset.add_frame(frame | {"task": config.task or _task(recording, episode)})
        dataset.save_episode()
        counts.append(len(episode))
    if dataset is None:
        names = ", ".join(str(recording.path) for recording in recordings)
        raise InputError(f"{names}: no stretch in {' or '.join(config.modes).upper()} of at least two frames")
    dataset.finalize()
    return counts


def _episodes(recordings: list[Recording], config: RecordDataset) -> Iterator[tuple[Recording, Episode]]:
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import Progress  # noqa: PLC0415

    from humanoid_sim.messages import Mode  # noqa: PLC0415
    from humanoid_sim.recording.episodes import read_episodes  # noqa: PLC0415

    modes = frozenset(Mode[name.upper()] for name in config.modes)
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        for recording in recordings:
            bar = progress.add_task(recording.path.name, total=recording.size)
            for episode in read_episodes(recording, modes, config.fps):
                yield recording, episode
                progress.update(bar, completed=recording.position)


def _features(recording: Recording, motion: Motion | None) -> dict[str, Any]:
    """Return the dataset's features: all float32, every value named."""
    joints = recording.header.joint_names
    names: dict[str, list[str]] = {
        "observation.state": [f"{joint}.pos" for joint in joints],
        "observation.velocity": [f"{joint}.vel" for joint in joints],
        "observation.effort": [f"{joint}.effort" for joint in joints],
        "observation.imu": list(_IMU),
        "action": [f"{joint}.pos" for joint in joints],
    }
    for name, (_, words) in ({} if motion is None else _reference(motion)).items():
        names[name] = words
    return {name: {"dtype": "float32", "shape": (len(words),), "names": words} for name, words in names.items()}


def _reference(motion: Motion) -> dict[str, tuple[slice, list[str]]]:
    """Return the features of a reference motion: which part of a frame, and what its values are called."""
    bodies, joints = motion.body_names, motion.joint_names
    n, b = len(joints), len(bodies)
    position = [f"{body}.{axis}" for body in bodies for axis in "xyz"]
    if motion.layout == "joints_bodies_w":
        quaternion = [f"{body}.q{axis}" for body in bodies for axis in "wxyz"]
        return {
            "reference.joint_pos": (slice(0, n), [f"{joint}.pos" for joint in joints]),
            "reference.joint_vel": (slice(n, 2 * n), [f"{joint}.vel" for joint in joints]),
            "reference.body_pos_w": (slice(2 * n, 2 * n + 3 * b), position),
            "reference.body_quat_w": (slice(2 * n + 3 * b, 2 * n + 7 * b), quaternion),
        }
    rotation = [f"{body}.r{place}" for body in bodies for place in ("00", "01", "10", "11", "20", "21")]
    return {
        "reference.motion_body_pos_b": (slice(0, 3 * b), position),
        "reference.motion_body_ori_b": (slice(3 * b, 9 * b), rotation),
    }


def _motion(recording: Recording) -> Motion:
    from humanoid_sim.policy.motion import MOTION_ATTACHMENT, parse_motion  # noqa: PLC0415

    data = recording.header.attachments.get(MOTION_ATTACHMENT)
    if data is None:
        raise InputError(f"--reference: {recording.path} holds no reference motion")
    motion = parse_motion(data, f"{recording.path}: {MOTION_ATTACHMENT}")
    if not motion.body_names:
        raise InputError(f"--reference: the motion of {recording.path} does not name its bodies")
    return motion


def _frames(episode: Episode, motion: Motion | None, recording: Recording) -> Iterator[dict[str, Any]]:
    import numpy as np  # noqa: PLC0415

    columns = {
        "observation.state": episode.joint_position,
        "observation.velocity": episode.joint_velocity,
        "observation.effort": episode.joint_effort,
        "observation.imu": episode.imu,
        "action": episode.command_position,
    }
    reference = {} if motion is None else _reference(motion)
    for i in range(len(episode)):
        frame = {name: values[i].astype(np.float32) for name, values in columns.items()}
        if motion is not None:
            shown = episode.motion_frame[i]
            if shown < 0:
                raise InputError(f"--reference: {recording.path} was under remote control; use --modes locomotion")
            row = motion.frames[min(shown, len(motion.frames) - 1)]
            frame |= {name: row[part].copy() for name, (part, _) in reference.items()}
        yield frame


def _task(recording: Recording, episode: Episode) -> str:
    from humanoid_sim.recording.reader import recorded_settings  # noqa: PLC0415

    settings = recorded_settings(recording.path, recording.header)
    motion, policy = (str(settings.get(name) or "") for name in ("motion", "policy"))
    if episode.mode.name == "REMOTE":
        return "follow remote commands"
    if motion:
        return f"follow the motion {Path(motion).stem}"
    return f"run the policy {Path(policy).stem}" if policy else "run a policy"


def _check_loads(library: Any, root: Path, repo_id: str, counts: list[int]) -> None:
    """Check that the library itself finds what was written, before the dataset gets its name."""
    loaded = library.LeRobotDataset(repo_id, root=root)
    found = [int(loaded.meta.episodes[i]["length"]) for i in range(loaded.meta.total_episodes)]
    if found != counts or len(loaded.hf_dataset) != sum(counts):
        raise RuntimeError(f"lerobot finds episodes of {found} frames where {counts} were written")
