"""`python -m humanoid_sim.sysid run.mcap --robot my.yaml`: a simulation that moves as the robot in recordings did."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import tyro

from humanoid_sim.command_line import parse

__all__ = ["SysidConfig", "main"]


@dataclass(frozen=True)
class SysidConfig:
    """Fit a robot's dynamics to recordings of it: per joint what motor, gear and bus make of a command.

    Armature, friction, damping, torque over commanded torque, homing offset and delay. What the data cannot decide
    stays as it is and is named. The fit is judged on data that it did not see. Exit status 0: it predicts them better
    than the robot did before; 1: it does not. Contact is not modelled: legs are identified with the robot hanging.
    """

    recordings: tuple[Path, ...]
    """Recordings (.mcap) of `play`, in simulation, on emulated or on real motors."""
    robot: str = "lite"
    """The robot as it is described so far: a shipped robot ({robots}), robot_descriptions:NAME, or the path of
    a robot's YAML file or of an MJCF."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("fitted")
    """Folder for the fitted robot.yaml, randomisation.yaml for training, sysid.json and the report sysid.html."""
    judge: Path | None = None
    """Another recording to judge the fit by. Default: the last third of each, which is then not fitted."""
    share: Literal["joint", "model"] = "joint"
    """Owners of parameters: each joint, or all joints with the same model of motor, which share them."""
    only: tuple[Literal["armature", "friction", "damping", "torque_scale", "offset", "delay"], ...] = ()
    """Parameters to fit; the others stay as they are. Default: all."""
    calibration: Path | None = None
    """calibration.yaml with which the recordings were made; a corrected one is written beside the rest."""
    overwrite: bool = False
    """Replace files in the folder."""

    GROUPS: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "most used": ("robot", "output", "overwrite"),
        "what is fitted": ("share", "only", "judge", "calibration"),
    }
    EXAMPLES: ClassVar[tuple[tuple[str, str], ...]] = (
        ("run.mcap --robot my.yaml -o fitted", "a robot file that moves as the recorded robot"),
        ("today.mcap --judge yesterday.mcap", "does it hold for another run?"),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `sysid` with command-line arguments; returns the exit status."""
    config = parse(SysidConfig, "sysid", arguments, positional=True)

    from humanoid_sim.sysid.run import identify  # noqa: PLC0415 - MuJoCo stays out of `--help`

    return identify(config)
