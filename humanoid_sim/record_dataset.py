"""`python -m humanoid_sim.record dataset`: recordings become a LeRobot dataset (format v3.0)."""

from __future__ import annotations

import importlib
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import tyro

from humanoid_sim.errors import InputError, blaming, needing
from humanoid_sim.messages import Mode, TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.recording.header import json_document
from humanoid_sim.recording.reader import Recording, open_recording

_DEFAULT_RATE = 50.0  # frames per second where no policy step says better; the control rate if that is lower
_MODES = (Mode.LOCOMOTION, Mode.REMOTE)
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
    fps: int | None = None
    """Frames per second; must divide the control rate. Default: the policy's steps, 50 where there are none."""

    def run(self) -> None:
        """Write the dataset. Raises `InputError` if it cannot be made."""
        output = self.output.resolve()
        if output.exists() or not output.parent.is_dir():
            raise InputError(f"--output: is '{self.output}', expected a new folder in one that exists")
        if self.fps is not None and self.fps < 1:
            raise InputError(f"--fps: is {self.fps}, expected at least 1")
        recordings = [open_recording(path) for path in self.recordings]
        for recording in recordings[1:]:
            if recording.header.joint_names != recordings[0].header.joint_names:
                raise InputError(f"{recording.path}: is of another robot than {recordings[0].path}")
        os.environ.setdefault("HF_HUB_OFFLINE", "1")  # read when the hub's package is imported
        with needing("lerobot", "lerobot", "record dataset"):
            library = importlib.import_module("lerobot.datasets.lerobot_dataset")
        repo_id = self.repo_id or f"local/{output.name}"
        staging = output.with_name(f".{output.name}.{os.getpid()}.tmp")
        try:
            with blaming(f"{self.output}: cannot be written", OSError):
                counts = self._write(library, staging, repo_id, recordings)
                staging.rename(output)
        finally:
            shutil.rmtree(staging, ignore_errors=True)
        print(f"{self.output}: {len(counts)} episodes, {sum(counts)} frames, as {repo_id}")

    def _write(self, library: Any, root: Path, repo_id: str, recordings: list[Recording]) -> list[int]:
        """Write everything below `root`; returns the number of frames of each episode.

        Raises `InputError` without an episode, or where two have different frame rates.
        """
        header = recordings[0].header
        names = {
            "observation.state": [f"{joint}.pos" for joint in header.joint_names],
            "observation.velocity": [f"{joint}.vel" for joint in header.joint_names],
            "observation.effort": [f"{joint}.effort" for joint in header.joint_names],
            "observation.imu": list(_IMU),
            "action": [f"{joint}.pos" for joint in header.joint_names],
        }
        features = {key: {"dtype": "float32", "shape": (len(n),), "names": n} for key, n in names.items()}
        dataset, rate, counts = None, 0, []
        for recording, episode in ((one, two) for one in recordings for two in read_episodes(one, self.fps)):
            if dataset is None:
                rate = round(episode.fps)
                dataset = library.LeRobotDataset.create(
                    repo_id, rate, features, root=root, robot_type=header.robot, use_videos=False
                )
            if abs(episode.fps - rate) > 1e-6 * rate:
                raise InputError(f"{recording.path}: {episode.fps:g} frames a second, others {rate:g}; choose --fps")
            task = self.task or _task(recording, episode)
            for tick in episode.ticks:
                frame = {key: one.astype(np.float32) for key, one in zip(names, _values(tick), strict=True)}
                dataset.add_frame({**frame, "task": task})
            dataset.save_episode()
            counts.append(len(episode.ticks))
        if dataset is None:
            raise InputError(f"{self.recordings[0]}: no stretch in LOCOMOTION or REMOTE of two frames")
        dataset.finalize()
        return counts


def _values(tick: TickRecord) -> tuple[FloatArray, ...]:
    """Return the values of a frame, in the order of the features."""
    state = tick.input.state
    imu = np.concatenate([state.imu_quaternion, state.imu_angular_velocity, state.imu_linear_acceleration])
    return state.joint_position, state.joint_velocity, state.joint_effort, imu, tick.output.command.position


class Episode(NamedTuple):
    """A stretch of a recording in which one controller moved the robot, sampled evenly."""

    mode: Mode
    fps: float
    ticks: list[TickRecord]  # one for each frame, in which every joint was received


def read_episodes(recording: Recording, fps: float | None = None) -> Iterator[Episode]:
    """Yield the stretches in LOCOMOTION and REMOTE of at least two frames, in order.

    A missed deadline, a lost tick or a joint that was never received ends a stretch. In LOCOMOTION it begins with a
    policy step, so that at the policy's rate every frame is one. Raises `InputError` if the control rate is not a
    multiple of `fps`.
    """
    period, stretch = recording.header.control_period, list[TickRecord]()
    for tick in recording.ticks():
        mode = tick.output.control_mode.mode
        if stretch:
            before = stretch[-1]
            step = float(tick.input.state.time) - float(before.input.state.time)
            is_same = mode is before.output.control_mode.mode and tick.index == before.index + 1
            if not is_same or abs(step - period) > 0.5 * period:
                yield from _sample(recording, stretch, fps)
                stretch = []
        is_begun = stretch or mode is not Mode.LOCOMOTION or tick.output.policy_step is not None
        if mode in _MODES and is_begun and np.isfinite(tick.input.state.joint_position).all():
            stretch.append(tick)
    yield from _sample(recording, stretch, fps)


def _sample(recording: Recording, stretch: list[TickRecord], fps: float | None) -> Iterator[Episode]:
    """Yield the episode of a stretch, unless it is shorter than two frames."""
    control = 1.0 / recording.header.control_period
    steps = [tick.index for tick in stretch if tick.output.policy_step is not None]
    rate = fps or (control / (steps[1] - steps[0]) if len(steps) > 1 else min(_DEFAULT_RATE, control))
    step = max(1, round(control / rate))
    if abs(control / rate - step) > 1e-6:
        raise InputError(f"{recording.path}: --fps: is {rate:g}, expected a divisor of its {control:g} ticks a second")
    if len(stretch) > step:
        yield Episode(stretch[0].output.control_mode.mode, rate, stretch[::step])


def _task(recording: Recording, episode: Episode) -> str:
    if episode.mode is Mode.REMOTE:
        return "follow remote commands"
    settings = json_document(recording.header, "settings")
    motion, policy = (Path(str(settings.get(name) or "")).stem for name in ("motion", "policy"))
    return f"follow the motion {motion}" if motion else f"run the policy {policy}"
