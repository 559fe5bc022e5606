"""`python -m humanoid_sim.training motions|train|evaluate`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tyro

from humanoid_sim.cli import run_program
from humanoid_sim.errors import InputError, MissingPackageError
from humanoid_sim.training.config import EvaluateConfig, MotionsConfig, TrainConfig

_Command = (
    Annotated[MotionsConfig, tyro.conf.subcommand("motions", prefix_name=False)]
    | Annotated[TrainConfig, tyro.conf.subcommand("train", prefix_name=False)]
    | Annotated[EvaluateConfig, tyro.conf.subcommand("evaluate", prefix_name=False)]
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one of the three; returns the exit status."""
    config: MotionsConfig | TrainConfig | EvaluateConfig = tyro.cli(
        _Command,
        prog="humanoid_sim.training",
        description="How the sample policy and the sample motions are made, and measured.",
        args=arguments,
    )
    # Each program imports what it needs: only `train` needs PyTorch.
    match config:
        case MotionsConfig():
            return _write_motions(config)
        case TrainConfig():
            try:
                from humanoid_sim.training.train import train  # noqa: PLC0415
            except ModuleNotFoundError as error:
                if error.name != "torch":
                    raise
                raise MissingPackageError("torch", "train", "training") from None
            return train(config)
        case EvaluateConfig():
            from humanoid_sim.training.report import evaluate  # noqa: PLC0415

            return evaluate(config)


def _write_motions(config: MotionsConfig) -> int:
    from humanoid_sim.policy.motion import write_motion  # noqa: PLC0415
    from humanoid_sim.robots.description import load_robot  # noqa: PLC0415
    from humanoid_sim.training.motions import SAMPLES, sample_motion  # noqa: PLC0415

    folder = Path(config.output)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made a folder: {error.strerror}") from None
    description = load_robot("lite")
    for name in SAMPLES:
        motion, _ = sample_motion(description, name)
        write_motion(folder / f"{name}.mcap", motion)
        print(f"{folder / name}.mcap: {len(motion.frames)} frames, {motion.duration:g} s")
    return 0


if __name__ == "__main__":
    sys.exit(run_program(main))
