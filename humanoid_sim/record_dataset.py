"""`python -m humanoid_sim.record dataset`: recordings become a LeRobot dataset (format v3.0)."""

from __future__ import annotations

import importlib
import os
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro

from humanoid_sim.errors import InputError, blaming, needing
from humanoid_sim.messages import Mode
from humanoid_sim.recording.episodes import Episode, read_episodes
from humanoid_sim.recording.header import json_document
from humanoid_sim.recording.reader import Recording, open_recording

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


def record_dataset(config: RecordDataset) -> None:
    """Write the dataset. Raises `InputError` if it cannot be made."""
    output = config.output.resolve()
    if output.exists() or not output.parent.is_dir():
        raise InputError(f"--output: is '{config.output}', expected a new folder in one that exists")
    if config.fps is not None and config.fps < 1:
        raise InputError(f"--fps: is {config.fps}, expected at least 1")
    recordings = [open_recording(path) for path in config.recordings]
    for recording in recordings[1:]:
        if recording.header.joint_names != recordings[0].header.joint_names:
            raise InputError(f"{recording.path}: is of another robot than {recordings[0].path}")
    os.environ.setdefault("HF_HUB_OFFLINE", "1")  # read when the hub's package is imported
    with needing("lerobot", "lerobot", "record dataset"):
        library = importlib.import_module("lerobot.datasets.lerobot_dataset")
    repo_id = config.repo_id or f"local/{output.name}"
    staging = output.with_name(f".{output.name}.{os.getpid()}.tmp")
    try:
        with blaming(f"{config.output}: cannot be written", OSError):
            counts = _write(library, staging, repo_id, recordings, config)
            staging.rename(output)
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    print(f"{config.output}: {len(counts)} episodes, {sum(counts)} frames, as {repo_id}")


def _write(library: Any, root: Path, repo_id: str, recordings: Iterable[Recording], config: RecordDataset) -> list[int]:
    """Write everything below `root`; returns the number of frames of each episode.

    Raises `InputError` if there is no episode, or two have different frame rates.
    """
    modes = frozenset(Mode[name.upper()] for name in config.modes)
    dataset, rate, counts = None, 0.0, []
    for recording in recordings:
        for episode in read_episodes(recording, modes, config.fps):
            if dataset is None:
                rate = round(episode.fps)
                names = _names(recording.header.joint_names)
                features = {key: {"dtype": "float32", "shape": (len(n),), "names": n} for key, n in names.items()}
                robot = recording.header.robot
                dataset = library.LeRobotDataset.create(
                    repo_id, rate, features, root=root, robot_type=robot, use_videos=False
                )
            if abs(episode.fps - rate) > 1e-6 * rate:
                raise InputError(f"{recording.path}: {episode.fps:g} frames a second, others {rate:g}; choose --fps")
            task = config.task or _task(recording, episode)
            for tick in episode.ticks:
                state = tick.input.state
                imu = state.imu_quaternion, state.imu_angular_velocity, state.imu_linear_acceleration
                values = (
                    state.joint_position,
                    state.joint_velocity,
                    state.joint_effort,
                    np.concatenate(imu),
                    tick.output.command.position,
                )
                frame = {key: one.astype(np.float32) for key, one in zip(names, values, strict=True)}
                dataset.add_frame({**frame, "task": task})
            dataset.save_episode()
            counts.append(len(episode.ticks))
    if dataset is None:
        raise InputError(f"{config.recordings[0]}: no stretch in {' or '.join(config.modes).upper()} of two frames")
    dataset.finalize()
    return counts


def _names(joints: Iterable[str]) -> dict[str, list[str]]:
    """Return the names of the values of each feature, in the order of a frame's."""
    return {
        "observation.state": [f"{joint}.pos" for joint in joints],
        "observation.velocity": [f"{joint}.vel" for joint in joints],
        "observation.effort": [f"{joint}.effort" for joint in joints],
        "observation.imu": list(_IMU),
        "action": [f"{joint}.pos" for joint in joints],
    }


def _task(recording: Recording, episode: Episode) -> str:
    if episode.mode is Mode.REMOTE:
        return "follow remote commands"
    settings = json_document(recording.header, "settings")
    motion, policy = (Path(str(settings.get(name) or "")).stem for name in ("motion", "policy"))
    return f"follow the motion {motion}" if motion else f"run the policy {policy}"
