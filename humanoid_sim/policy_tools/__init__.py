"""`python -m humanoid_sim.policy show|check|stamp|doctor`: look into a checkpoint, check it, complete it.

Nothing heavy is imported here: `--help` must be quick.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from humanoid_sim.assets import policy_path
from humanoid_sim.cli import parse
from humanoid_sim.doctor import DoctorConfig
from humanoid_sim.errors import InputError


@dataclass(frozen=True)
class Show:
    """Show the contract of a checkpoint: joints, observation, action, and where each field came from."""

    checkpoint: tyro.conf.Positional[Path]
    """ONNX file, or a shipped policy."""
    contract: Path | None = None
    """A contract.yaml with what the checkpoint does not say. Default: the one beside it."""
    robot: str | None = None
    """A shipped robot, robot_descriptions:NAME, a YAML file or an MJCF; only for contracts that
    name the joints by their places on the robot."""
    joints: bool = False
    """Also show gains, pose and action of each joint."""
    skeleton: Path | None = None
    """A contract.yaml to write, with a line to fill in for each field that no source gives."""
    json: bool = False
    """Print everything as JSON."""


@dataclass(frozen=True)
class Check:
    """Check a checkpoint against a robot without running it there. Exit status 1 if anything is an error."""

    checkpoint: tyro.conf.Positional[Path]
    """ONNX file, or a shipped policy."""
    robot: str
    """A shipped robot, robot_descriptions:NAME, a YAML file or an MJCF."""
    imu_site: str | None = None
    """The site or body of the robot's MJCF that is its IMU. Default: the robot's; of an MJCF its gyro's site."""
    contract: Path | None = None
    """A contract.yaml with what the checkpoint does not say. Default: the one beside it."""
    hardware: bool = False
    """For the real robot: what only a simulation knows is an error."""
    physics_timestep: float | None = None
    """s of the simulation. Default: the robot's."""
    json: bool = False
    """Print the findings as JSON."""


@dataclass(frozen=True)
class Stamp:
    """Write a copy of a checkpoint that holds its contract, its external tensors and golden vectors itself."""

    checkpoint: tyro.conf.Positional[Path]
    """ONNX file, or a shipped policy."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """File to write."""
    contract: Path | None = None
    """A contract.yaml with what the checkpoint does not say. Default: the one beside it."""
    robot: str | None = None
    """A shipped robot, robot_descriptions:NAME, a YAML file or an MJCF: for joints given by
    place, and for a trace's anchor poses."""
    trace: Path | None = None
    """The trainer's run (.npz) to take golden vectors from. Default: those that the checkpoint has already."""
    motion: Path | None = None
    """The motion (.mcap) of the trace, where the model does not carry it."""
    overwrite: bool = False
    """Replace the output if it exists."""


_PROGRAMS = {
    Show: ("policy_tools.show", "show"),
    Check: ("policy_tools.check", "check"),
    Stamp: ("policy_tools.stamp", "stamp_copy"),
    DoctorConfig: ("doctor.report", "doctor"),
}
"""By options the module and function that take them; heavy, so only what runs is imported."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `policy` with command-line arguments; returns the exit status."""
    command: Show | Check | Stamp | DoctorConfig = parse(
        Show | Check | Stamp | Annotated[DoctorConfig, tyro.conf.subcommand("doctor")], "policy", arguments
    )
    command = replace(command, checkpoint=policy_path(command.checkpoint, "CHECKPOINT"))
    from humanoid_sim.policy.onnx_policy import check_file, has_onnxruntime  # noqa: PLC0415

    check_file(command.checkpoint)
    if not has_onnxruntime():
        raise InputError("policy: needs onnxruntime, which cannot be imported: pip install onnxruntime")
    module, program = _PROGRAMS[type(command)]
    run: Callable[[Any], int] = getattr(importlib.import_module(f"humanoid_sim.{module}"), program)
    return run(command)
