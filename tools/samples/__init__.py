"""The factories of the sample policies, motions and songs, and how they are measured: `python -m tools.samples`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from humanoid_sim.assets import PIANO_POLICY, SAMPLE_POLICY, WALKING_POLICY, policy_path
from humanoid_sim.command_line import Commands, parse
from humanoid_sim.errors import MissingPackageError

__all__ = [
    "EvaluateConfig",
    "EvaluateWalkingConfig",
    "MotionsConfig",
    "SongsConfig",
    "TraceConfig",
    "TracePianoConfig",
    "TraceWalkingConfig",
    "TrainPianoConfig",
    "TrainSampleConfig",
    "TrainWalkingConfig",
    "main",
]


@dataclass(frozen=True)
class MotionsConfig:
    """Make the sample motions."""

    output: str = "motions"
    """Folder for the .mcap files; made if it is missing."""


@dataclass(frozen=True)
class SongsConfig:
    """Make the sample songs."""

    output: str = "songs"
    """Folder for the .mid files; made if it is missing."""


@dataclass(frozen=True)
class TrainSampleConfig:
    """Train the sample policy that tracks motions for the Lite's arms, and write it as ONNX."""

    output: str = "lite_tracking.onnx"
    """The checkpoint; written under a temporary name and renamed at the end."""
    seed: int = 0
    """Seed of everything random."""
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
    """Threads of PyTorch. More are little faster, and sum in another order: the same seed then gives another policy."""
    quick: bool = False
    """A few updates on little data: shows that everything runs, the policy is no good."""


@dataclass(frozen=True)
class EvaluateConfig:
    """Measure a tracking policy in closed loop, beside inverse kinematics through the same gains."""

    policy: str | None = None
    """ONNX checkpoint, or a shipped policy ({policies}). Default: the sample policy."""
    motion: tuple[str, ...] = ()
    """Motion files (.mcap). Default: the sample motions."""
    random: int = 0
    """Random motions to measure as well, of the kind that the policy was trained on, but others."""
    seed: int = 0
    """Seed of the random motions."""
    command_delay: float = 0.0
    """s from a command to the motors' obeying it; a multiple of the physics step."""
    bus: bool = False
    """Time it as on the real robot's bus: 50 Hz control, and states as old as the last command."""
    json: str | None = None
    """Write the figures to this file too."""


@dataclass(frozen=True)
class TrainPianoConfig:
    """Train the sample policy that plays the piano, and write it as ONNX."""

    output: str = "lite_piano.onnx"
    """The checkpoint; written under a temporary name and renamed at the end."""
    seed: int = 0
    """Seed of everything random."""
    songs: int = 140
    """Generated songs of 14 s each to train on."""
    rounds: int = 3
    """Number of times that the network plays them all, so that it learns from its own mistakes."""
    epochs: int = 4
    """Over all that was seen so far, in each round."""


@dataclass(frozen=True)
class TraceConfig:
    """Write a run of the sample policy as its trainer sees it, for `humanoid_sim.policy stamp --trace`."""

    policy: str | None = None
    """ONNX checkpoint, as `train-sample` writes it. Default: the sample policy."""
    output: str = "trace.npz"
    """The trace."""


@dataclass(frozen=True)
class TracePianoConfig:
    """Write a run of the piano policy as its trainer sees it, for `humanoid_sim.policy stamp --trace`."""

    policy: str | None = None
    """ONNX checkpoint, as `train-piano` writes it. Default: the sample policy."""
    output: str = "trace.npz"
    """The trace, of the sample song that `prepare --song` makes the `--motion` of."""


@dataclass(frozen=True)
class TrainWalkingConfig:
    """Train the walking policy for the Lite's legs with stable-baselines3's PPO, and write it as ONNX."""

    output: str = "lite_biped_velocity.onnx"
    """The checkpoint; written under a temporary name and renamed at the end."""
    folder: str = "runs/walking"
    """For checkpoints of the training: one at the end of each stage, and one every two minutes."""
    resume: bool = False
    """Go on from the latest checkpoint in the folder."""
    seed: int = 0
    """Seed of everything random. The same seed gives the same figures, not the same bits: threads share the physics."""
    threads: int = 1
    """Threads of PyTorch. Physics takes all processors; the networks are too small to gain from more than one."""
    quick: bool = False
    """A few updates of each stage: shows that everything runs, the policy is no good."""


@dataclass(frozen=True)
class TraceWalkingConfig:
    """Write a run of the walking policy as its trainer sees it, for `humanoid_sim.policy stamp --trace`."""

    policy: str | None = None
    """ONNX checkpoint, as `train-walking` writes it. Default: the sample policy."""
    output: str = "trace.npz"
    """The trace."""


@dataclass(frozen=True)
class EvaluateWalkingConfig:
    """Measure a walking policy: commands held, pushes, friction and mass."""

    policy: str | None = None
    """ONNX checkpoint, or a shipped policy ({policies}). Default: the sample policy."""
    seeds: int = 20
    """Robots of each case."""
    only: str | None = None
    """Run only the cases whose name contains this text."""
    actuation: Literal["affine", "implicit"] = "affine"
    """affine agrees with the reference plant; implicit is what it was trained on."""
    json: str | None = None
    """Write the figures to this file too."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `tools.samples` with command-line arguments; returns the exit status."""
    config: (
        MotionsConfig
        | SongsConfig
        | TrainSampleConfig
        | TrainPianoConfig
        | TraceConfig
        | TracePianoConfig
        | EvaluateConfig
        | TrainWalkingConfig
        | TraceWalkingConfig
        | EvaluateWalkingConfig
    ) = parse(
        Commands(
            "Make the sample policies, motions and songs again, and measure them.",
            {
                "motions": MotionsConfig,
                "songs": SongsConfig,
                "train-sample": TrainSampleConfig,
                "train-piano": TrainPianoConfig,
                "trace": TraceConfig,
                "trace-piano": TracePianoConfig,
                "evaluate": EvaluateConfig,
                "train-walking": TrainWalkingConfig,
                "trace-walking": TraceWalkingConfig,
                "evaluate-walking": EvaluateWalkingConfig,
            },
        ),
        "tools.samples",
        arguments,
        positional=True,
    )
    # Each program imports what it needs: only training needs PyTorch.
    match config:
        case MotionsConfig() | SongsConfig():
            return _samples(config)
        case TrainSampleConfig() | TrainPianoConfig():
            return _sample_policies(config)
        case TraceConfig() | TracePianoConfig():
            return _trace(config)
        case EvaluateConfig():
            from tools.samples.evaluate import evaluate  # noqa: PLC0415

            return evaluate(config)
        case _:
            return _walking(config)


def _samples(config: MotionsConfig | SongsConfig) -> int:
    if isinstance(config, SongsConfig):
        from tools.samples.songs import write_songs  # noqa: PLC0415

        write_songs(Path(config.output))
        return 0
    from tools.samples.motions import write_samples  # noqa: PLC0415

    write_samples(Path(config.output))
    return 0


def _sample_policies(config: TrainSampleConfig | TrainPianoConfig) -> int:
    name = "train-piano" if isinstance(config, TrainPianoConfig) else "train-sample"
    try:
        if isinstance(config, TrainPianoConfig):
            from tools.samples.piano.train import train_piano  # noqa: PLC0415

            return train_piano(config)
        from tools.samples.train import train_sample  # noqa: PLC0415
    except ModuleNotFoundError as error:
        if error.name != "torch":
            raise
        raise MissingPackageError("torch", "train", name) from None
    return train_sample(config)


def _trace(config: TraceConfig | TracePianoConfig) -> int:
    if isinstance(config, TracePianoConfig):
        from tools.samples.piano.trace import write_piano_trace  # noqa: PLC0415

        return write_piano_trace(policy_path(config.policy or PIANO_POLICY), Path(config.output))
    from tools.samples.trace import write_trace  # noqa: PLC0415

    return write_trace(policy_path(config.policy or SAMPLE_POLICY), Path(config.output))


def _walking(config: TrainWalkingConfig | TraceWalkingConfig | EvaluateWalkingConfig) -> int:
    match config:
        case TrainWalkingConfig():
            try:
                from tools.samples.walking.train import train_walking  # noqa: PLC0415
            except ModuleNotFoundError as error:
                if error.name not in ("torch", "stable_baselines3"):
                    raise
                raise MissingPackageError(str(error.name), "rl", "train-walking") from None
            return train_walking(config)
        case TraceWalkingConfig():
            from tools.samples.walking.trace import write_walking_trace  # noqa: PLC0415

            path = policy_path(config.policy or WALKING_POLICY)
            return write_walking_trace(path, Path(config.output))
        case EvaluateWalkingConfig():
            from tools.samples.walking.evaluate import evaluate_walking  # noqa: PLC0415

            path = policy_path(config.policy or WALKING_POLICY)
            output = None if config.json is None else Path(config.json)
            return evaluate_walking(path, config.seeds, config.only, output, config.actuation)
