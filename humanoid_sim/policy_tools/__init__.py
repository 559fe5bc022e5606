"""`python -m humanoid_sim.policy show|check|stamp|doctor`: look into a checkpoint, check it, complete it.

Nothing heavy is imported here: `--help` must be quick.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro

from humanoid_sim.assets import policy_path
from humanoid_sim.cli import parse
from humanoid_sim.doctor import DoctorConfig

_ROBOT = "A shipped robot, robot_descriptions:NAME, a YAML file or an MJCF"
_CONTRACT = "A contract.yaml with what the checkpoint does not say. Default: the one beside it."
_Checkpoint = Annotated[tyro.conf.Positional[Path], tyro.conf.arg(help="ONNX file, or a shipped policy.")]
_Contract = Annotated[Path | None, tyro.conf.arg(help=_CONTRACT)]


@dataclass(frozen=True)
class Show:
    """Show the contract of a checkpoint: joints, observation, action, and where each field came from."""

    checkpoint: _Checkpoint
    contract: _Contract = None
    robot: Annotated[str | None, tyro.conf.arg(help=f"{_ROBOT}: for contracts that name joints by place.")] = None


@dataclass(frozen=True)
class Check:
    """Check a checkpoint against a robot without running it there. Exit status 1 if anything is an error."""

    checkpoint: _Checkpoint
    robot: Annotated[str, tyro.conf.arg(help=f"{_ROBOT}.")]
    contract: _Contract = None
    hardware: bool = False
    """For the real robot: what only a simulation knows is an error."""


@dataclass(frozen=True)
class Stamp:
    """Write a copy of a checkpoint that holds its contract, its external tensors and golden vectors itself."""

    checkpoint: _Checkpoint
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """File to write."""
    contract: _Contract = None
    robot: Annotated[str | None, tyro.conf.arg(help=f"{_ROBOT}: for joints given by place, and a trace's qpos.")] = None
    trace: Path | None = None
    """The trainer's run (.npz) to take golden vectors from. Default: those that the checkpoint has already."""
    motion: Path | None = None
    """The motion (.mcap) of the trace, where the model does not carry it."""
    overwrite: bool = False
    """Replace the output if it exists."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `policy` with command-line arguments; returns the exit status."""
    commands = Show | Check | Stamp | Annotated[DoctorConfig, tyro.conf.subcommand("doctor")]
    command: Show | Check | Stamp | DoctorConfig = parse(commands, "policy", arguments)
    command = replace(command, checkpoint=policy_path(command.checkpoint, "CHECKPOINT"))
    # Heavy modules, which `--help` does without.
    from humanoid_sim.doctor.report import doctor  # noqa: PLC0415
    from humanoid_sim.policy_tools.check import check  # noqa: PLC0415
    from humanoid_sim.policy_tools.show import show  # noqa: PLC0415
    from humanoid_sim.policy_tools.stamp import stamp_copy  # noqa: PLC0415

    if isinstance(command, Show):
        return show(command)
    if isinstance(command, Check):
        return check(command)
    return stamp_copy(command) if isinstance(command, Stamp) else doctor(command)
