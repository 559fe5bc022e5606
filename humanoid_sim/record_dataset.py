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


def record_dataset(config: RecordDataset) -> None:
    """Write the dataset. Raises `InputError` if it cannot be made."""
    from humanoid_sim.recording.reader import open_recording  # noqa: PLC0415

    output = config.output.resolve()
    if config.output.exists():
        raise InputError(f"--output: '{config.output}' exists; a dataset is only written whole, to a new folder")
    if not output.parent.is_dir():
        raise InputError(f"--output: the folder '{output.parent}' does not exist")
    if config.fps is not None and config.fps < 1:
        raise InputError(f"--fps: is {config.fps}, expected at least 1")
    repo_id = config.repo_id or f"local/{output.name}"
    if repo_id.count("/") != 1:
        raise InputError(f"--repo-id: is '{repo_id}', expected user/name")
    recordings = [open_recording(path) for path in config.recordings]
    for recording in recordings[1:]:
        if recording.header.joint_names != recordings[0].header.joint_names:
            raise InputError(f"{recording.path}: is of another robot than {recordings[0].path}")
    library = _import_lerobot()
    staging = output.with_name(f".{output.name}.{os.getpid()}.tmp")
    try:
        counts = _write(library, staging, repo_id, recordings, config)
        loaded = len(library.LeRobotDataset(repo_id, root=staging).hf_dataset)
        assert loaded == sum(counts), f"lerobot finds {loaded} frames where {sum(counts)} were written"
        staging.rename(config.output)
    except OSError as error:
        raise InputError(f"{config.output}: cannot be written: {error.strerror or error}") from None
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    print(f"{config.output}: {len(counts)} episodes, {sum(counts)} frames, as {repo_id}")


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
        features = _features(recording, motion)
        if dataset is None:
            rate, first = episode.fps, features
            if abs(rate - round(rate)) > 1e-6:
                raise InputError(f"{recording.path}: {rate:g} frames per second is not a whole number; choose --fps")
            dataset = library.LeRobotDataset.create(
                repo_id, round(rate), features, root=root, robot_type=recording.header.robot, use_videos=False
            )
        if abs(episode.fps - rate) > 1e-6 * rate:
            raise InputError(f"{recording.path}: {episode.fps:g} policy steps a second, first {rate:g}; choose --fps")
        if features != first:
            raise InputError(f"{recording.path}: its reference motion has other features than the first recording's")
        task = config.task or _task(recording, episode)
        for frame in _frames(episode, motion, recording):
            dataset.add_frame(frame | {"task": task})
        dataset.save_episode()
        counts.append(len(episode))
    if dataset is None:
        names = ", ".join(str(recording.path) for recording in recordings)
        raise InputError(f"{names}: no stretch in {' or '.join(config.modes).upper()} of at least two frames")
    dataset.finalize()
    return counts


def _episodes(recordings: list[Recording], config: RecordDataset) -> Iterator[tuple[Recording, Episode]]:
    from humanoid_sim.messages import Mode  # noqa: PLC0415
    from humanoid_sim.recording.episodes import read_episodes  # noqa: PLC0415

    modes = frozenset(Mode[name.upper()] for name in config.modes)
    for recording in recordings:
        for episode in read_episodes(recording, modes, config.fps):
            yield recording, episode


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
    names |= {} if motion is None else _reference(motion)
    return {name: {"dtype": "float32", "shape": (len(words),), "names": words} for name, words in names.items()}


def _reference(motion: Motion) -> dict[str, list[str]]:
    """Return the features of a reference motion, the parts of its frames in their order, and their values' names."""
    bodies, joints = motion.body_names, motion.joint_names
    position = [f"{body}.{axis}" for body in bodies for axis in "xyz"]
    if motion.layout == "joints_bodies_w":
        return {
            "reference.joint_pos": [f"{joint}.pos" for joint in joints],
            "reference.joint_vel": [f"{joint}.vel" for joint in joints],
            "reference.body_pos_w": position,
            "reference.body_quat_w": [f"{body}.q{axis}" for body in bodies for axis in "wxyz"],
        }
    places = ("00", "01", "10", "11", "20", "21")
    rotation = [f"{body}.r{place}" for body in bodies for place in places]
    return {"reference.motion_body_pos_b": position, "reference.motion_body_ori_b": rotation}


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

    if motion is not None and min(episode.motion_frame) < 0:
        raise InputError(f"--reference: {recording.path} was under remote control; use --modes locomotion")
    for tick, shown in zip(episode.ticks, episode.motion_frame, strict=True):
        state = tick.input.state
        imu = (state.imu_quaternion, state.imu_angular_velocity, state.imu_linear_acceleration)
        frame = {
            "observation.state": state.joint_position,
            "observation.velocity": state.joint_velocity,
            "observation.effort": state.joint_effort,
            "observation.imu": np.concatenate(imu),
            "action": tick.output.command.position,
        }
        if motion is not None:
            row, parts = motion.frames[min(shown, len(motion.frames) - 1)], _reference(motion)
            ends = np.cumsum([len(words) for words in parts.values()])
            frame |= dict(zip(parts, np.split(row[: ends[-1]], ends[:-1]), strict=True))
        yield {name: values.astype(np.float32) for name, values in frame.items()}


def _task(recording: Recording, episode: Episode) -> str:
    from humanoid_sim.recording.header import json_document  # noqa: PLC0415

    settings = json_document(recording.header, "settings")
    motion, policy = (Path(str(settings.get(name) or "")).stem for name in ("motion", "policy"))
    if episode.mode.name == "REMOTE":
        return "follow remote commands"
    if motion:
        return f"follow the motion {motion}"
    return f"run the policy {policy}" if policy else "run a policy"
