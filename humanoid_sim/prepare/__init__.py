"""`python -m humanoid_sim.prepare`: a checkpoint and a motion from elsewhere become files that `play` runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from humanoid_sim.cli import parse


@dataclass(frozen=True)
class PrepareOptions:
    """Make a motion file from a motion or a song that was made elsewhere, checked, and fetch the checkpoint.

    The motion is a LeRobot dataset (v3.0), an mjlab or whole_body_tracking .npz, or a .csv. Forward kinematics on the
    robot must put every body where the motion has it; if not, nothing is written.
    """

    policy: Annotated[str | None, tyro.conf.arg(aliases=["--checkpoint-file"])] = None
    """ONNX checkpoint, or a shipped policy; it determines the order of the motion's joints and
    bodies, and its frame rate."""
    contract: str | None = None
    """contract.yaml with what the checkpoint does not say."""
    wandb_run_path: str | None = None
    """W&B run (entity/project/run) to fetch the checkpoint from, instead of --policy."""
    wandb_file: Annotated[str | None, tyro.conf.arg(aliases=["--wandb-checkpoint-name"])] = None
    """The checkpoint's file name in the run. Default: the newest model_*."""
    robot: str = "lite"
    """A shipped robot, robot_descriptions:NAME, or the path of a robot's YAML file or MJCF (.xml)."""
    motion: Annotated[str | None, tyro.conf.arg(aliases=["--motion-file"])] = None
    """Motion: an .npz or .csv file, or the folder of a LeRobot dataset."""
    dataset: Annotated[str | None, tyro.conf.arg(aliases=["--registry-name"])] = None
    """LeRobot dataset by its id on the hub, user/name. Without --motion and this: the one that the checkpoint names."""
    song: str | None = None
    """MIDI file (.mid), or a sample song's name, whose notes become the goals of a piano policy; without a --policy,
    --fps is their rate."""
    tracks: tuple[int, ...] = ()
    """Tracks of the song to play, counted from 0. Default: all."""
    transpose: int = 0
    """Semitones by which the song is played higher."""
    voices: int | None = None
    """Most notes at a time; the highest is kept, then the lowest, then the hardest struck."""
    keys: str | None = None
    """Lowest and highest key that can be played, such as C3-C6. Notes beyond are left out, and named."""
    lead_in: float = 1.0
    """Least seconds of rest before the song's first note, in which the hands come over the keys."""
    sustain: bool = False
    """Notes sound on while the song's sustain pedal is down."""
    episode: Annotated[int | None, tyro.conf.arg(aliases=["--episode-index"])] = None
    """Episode of the dataset, counted from 0; required if it has more than one."""
    features: tuple[str, ...] = ()
    """For features with other names than the usual: ROLE=FEATURE, such as joint_pos=observation.qpos."""
    fps: float | None = None
    """Frames per second of a .csv without a column of times, or of a song without a policy (default 50)."""
    joint_order: str | None = None
    """Joint order where the motion names no joints: contract, robot, mjcf, breadth_first, or names with commas.
    Default: contract for .npz and datasets, robot for .csv."""
    body_order: str | None = None
    """Body order where the motion names no bodies: contract, mjcf, breadth_first, or names with commas.
    Default: contract if it has as many bodies, else mjcf."""
    quaternions: Literal["wxyz", "xyzw"] | None = None
    """Order of the motion's quaternions. Default: xyzw for .csv, wxyz for the other formats."""
    angle_unit: Literal["rad", "deg"] = "rad"
    """Unit of the motion's joint positions and velocities."""
    velocities: Literal["source", "positions"] = "source"
    """Source of joint velocities: the motion's own, or differences of its joint positions."""
    resample: bool = False
    """Interpolate a motion whose frame rate is not the policy's."""
    tolerance: float = 0.01
    """Largest distance, in m, between a body and where forward kinematics puts it."""
    angle_tolerance: float = 2.0
    """Largest angle, in degrees, between the two."""
    output: Annotated[str, tyro.conf.arg(aliases=["--out-dir"])] = "prepared"
    """Folder for the motion (.mcap), the report (.json) and a copy of the checkpoint; created if it is missing."""
    name: str | None = None
    """Name of the motion and of the report. Default: the motion's own."""
    overwrite: bool = False
    """Replace files in the folder."""
    timeout: float = 30.0
    """Seconds to wait for an answer from the network."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `prepare` with command-line arguments; returns the exit status."""
    options = parse(PrepareOptions, "prepare", arguments)

    from humanoid_sim.prepare.preparation import prepare  # noqa: PLC0415 - MuJoCo stays out of `--help`

    return prepare(options)
