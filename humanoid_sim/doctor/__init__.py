"""Find out what is wired wrongly in a policy that does not behave: try what usually is, one change at a time, and see.

`hypotheses` is the space of changes, `trials` tries one in simulation, `run` goes through them, `report` shows the
ranking. Nothing heavy is imported here: `--help` must be quick.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro


@dataclass(frozen=True)
class DoctorConfig:
    """Find out what is wired wrongly in a policy that does not behave.

    Changes the contract in every way in which contracts usually are wrong, one change at a time, tries each once in the
    same short simulated run, in which nothing holds the robot, and ranks them by how long and how well it stays up.
    Ctrl-C ends the search and shows the ranking so far. Exit status 0 if nothing wrong was found, else 1.
    """

    checkpoint: tyro.conf.Positional[Path]
    """ONNX file, or a shipped policy."""
    robot: str
    """A shipped robot, robot_descriptions:NAME, a YAML file or an MJCF."""
    imu_site: str | None = None
    """The site or body of the robot's MJCF that is its IMU. Default: the robot's; of an MJCF its gyro's site."""
    contract: Path | None = None
    """A contract.yaml with what the checkpoint does not say. Default: the one beside it."""
    motion: str | None = None
    """Motion to follow, if the checkpoint does not carry one: a sample motion, such as wave, or an .mcap
    file."""
    command: str | None = None
    """Velocity command vx,vy,wz in m/s, m/s and rad/s. Default: forward while turning."""
    seconds: float = 6.0
    """Length of each trial, of a motion at most all of it."""
    top: int = 10
    """Rows of the ranking."""
    base_height: float | None = None
    """Height in m at which the base starts. Default: the robot stands on the floor."""
    actuation: Literal["affine", "implicit"] = "affine"
    """Plant that simulates the motors: implicit takes longer steps, for policies that were trained and published so."""
    json: bool = False
    """Print the whole ranking as JSON."""
