"""How the sample policy and the sample motions are made, and measured: `python -m humanoid_sim.training`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from humanoid_sim.assets import SAMPLE_POLICY
from humanoid_sim.errors import MissingPackageError

__all__ = ["EvaluateConfig", "MotionsConfig", "TraceConfig", "TrainConfig", "main"]


@dataclass(frozen=True)
class MotionsConfig:
    """Make the sample motions."""

    output: str = "motions"
    """Folder for the .mcap files; made if it is missing."""


@dataclass(frozen=True)
class TrainConfig:
    """Train the tracking policy for the Lite's arms, and write it as ONNX."""

    output: str = "lite_tracking.onnx"
    """The checkpoint; written under a temporary name and renamed at the end."""
    seed: int = 0
    """Of everything random."""
    motions: int = 800
    """Random arm motions of 8 s each to train on."""
    poses: int = 250_000
    """Random arm poses to learn the geometry from."""
    static_steps: int = 5000
    """Updates of the first part, on poses."""
    loop_steps: int = 700
    """Updates of the second part, through the closed loop."""
    arms: int = 512
    """Arms simulated at once in the second part."""
    threads: int = 1
    """Of PyTorch. More are little faster, and sum in another order: the same seed then gives another policy."""
    quick: bool = False
    """A few updates on little data: shows that everything runs, the policy is no good."""


@dataclass(frozen=True)
class EvaluateConfig:
    """Measure a tracking policy in closed loop, beside inverse kinematics through the same gains."""

    policy: str | None = None
    """ONNX checkpoint. Default: the sample policy."""
    motion: tuple[str, ...] = ()
    """Motion files (.mcap). Default: the sample motions."""
    random: int = 0
    """Random motions to measure as well, of the kind that the policy was trained on, but others."""
    seed: int = 0
    """Of the random motions."""
    command_delay: float = 0.0
    """s from a command to the motors' obeying it; a multiple of the physics step."""
    bus: bool = False
    """Time it as on the real robot's bus: 50 Hz control, and states as old as the last command."""
    json: str | None = None
    """Write the figures to this file too."""


@dataclass(frozen=True)
class TraceConfig:
    """Write a run of the sample policy as its trainer sees it, for `humanoid_sim.policy stamp --trace`."""

    policy: str | None = None
    """ONNX checkpoint, as `train` writes it. Default: the sample policy."""
    output: str = "trace.npz"
    """The trace."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `training` with command-line arguments; returns the exit status."""
    import tyro  # noqa: PLC0415 - heavy imports stay out of importing this package

    config: MotionsConfig | TrainConfig | TraceConfig | EvaluateConfig = tyro.cli(
        Annotated[MotionsConfig, tyro.conf.subcommand("motions", prefix_name=False)]
        | Annotated[TrainConfig, tyro.conf.subcommand("train", prefix_name=False)]
        | Annotated[TraceConfig, tyro.conf.subcommand("trace", prefix_name=False)]
        | Annotated[EvaluateConfig, tyro.conf.subcommand("evaluate", prefix_name=False)],
        prog="humanoid_sim.training",
        description="How the sample policy and the sample motions are made, and measured.",
        args=arguments,
    )
    # Each program imports what it needs: only `train` needs PyTorch.
    match config:
        case MotionsConfig():
            from humanoid_sim.training.motions import write_samples  # noqa: PLC0415

            write_samples(Path(config.output))
            return 0
        case TrainConfig():
            try:
                from humanoid_sim.training.train import train  # noqa: PLC0415
            except ModuleNotFoundError as error:
                if error.name != "torch":
                    raise
                raise MissingPackageError("torch", "train", "training") from None
            return train(config)
        case TraceConfig():
            from humanoid_sim.training.trace import write_trace  # noqa: PLC0415

            return write_trace(SAMPLE_POLICY if config.policy is None else Path(config.policy), Path(config.output))
        case EvaluateConfig():
            from humanoid_sim.training.evaluate import evaluate  # noqa: PLC0415

            return evaluate(config)
