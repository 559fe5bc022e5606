"""`python -m humanoid_sim.prepare`: a motion or a song from elsewhere becomes a file that `play` follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from humanoid_sim.cli import parse


@dataclass(frozen=True)
class PrepareOptions:
    """Make a motion file of a motion or a song that was made elsewhere, checked against the robot.

    What a source does not say, an option must, unless forward kinematics on the robot confirms the usual meaning. A
    motion that does not fit is refused. Lengths are m.
    """

    policy: Annotated[str | None, tyro.conf.arg(aliases=["--checkpoint-file"])] = None
    """ONNX checkpoint, or a shipped policy, for which the motion is meant."""
    contract: str | None = None
    """contract.yaml with what the checkpoint does not say."""
    wandb_run_path: str | None = None
    """W&B run (entity/project/run) to fetch the checkpoint from, instead of --policy."""
    wandb_file: Annotated[str | None, tyro.conf.arg(aliases=["--wandb-checkpoint-name"])] = None
    """The checkpoint's file name in the run. Default: the newest model_*.onnx."""
    robot: str = "lite"
    """A shipped robot, robot_descriptions:NAME, or the path of a robot's YAML file or MJCF (.xml)."""
    motion: Annotated[str | None, tyro.conf.arg(aliases=["--motion-file", "--registry-name"])] = None
    """An .npz or .csv file, an .mcap file with joint states, or a LeRobot dataset: its folder, or user/name on the hub.
    Default: the dataset that the checkpoint names."""
    episode: Annotated[int | None, tyro.conf.arg(aliases=["--episode-index"])] = None
    """Episode of the dataset, counted from 0; required if it has more than one."""
    topic: str | None = None
    """Topic of the joint states, where a recording has several."""
    degrees: bool = False
    """The motion's joints are in degrees. Default: rad."""
    fps: float | None = None
    """Frames per second of a .csv without a column of times, or of a song without a policy (default 50)."""
    joint_order: str | None = None
    """Joint order where the motion names no joints: contract, robot, mjcf, breadth_first, or names with commas."""
    body_order: str | None = None
    """Body order where the motion names no bodies: contract, mjcf, breadth_first, or names with commas."""
    quaternions: Literal["wxyz", "xyzw"] | None = None
    """Order of the motion's quaternions."""
    resample: bool = False
    """Interpolate a motion whose frames do not come at the policy's rate."""
    song: str | None = None
    """MIDI file (.mid), or a sample song's name: what the robot can reach of it becomes a piano policy's goals."""
    output: Annotated[str, tyro.conf.arg(aliases=["--out-dir"])] = "prepared"
    """Folder for the motion (.mcap), and for a checkpoint from W&B; created if it is missing."""
    name: str | None = None
    """Name of the motion's file. Default: the source's own."""
    overwrite: bool = False
    """Replace a motion file in the folder."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `prepare` with command-line arguments; returns the exit status."""
    options = parse(PrepareOptions, "prepare", arguments)

    from humanoid_sim.prepare.preparation import prepare  # noqa: PLC0415 - MuJoCo stays out of `--help`

    return prepare(options)
