"""Train policies with another library's PPO on any task of the environments: `python -m humanoid_sim.training`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from humanoid_sim.training.ppo.options import CurvesConfig, TrainConfig

__all__ = ["CurvesConfig", "TrainConfig", "export_policy", "main"]


def export_policy(model: Any, envs: Any, output: str | os.PathLike[str]) -> Path:
    """Write a policy that a loop of your own has trained, with contract and golden vectors, as `train` writes its own.

    What `play`, `regress` and `policy check` then read is one file. The golden vectors are of a run in which the model
    itself answers, in the environment as it is without randomisation. Raises `InputError` if the model or the
    environments are of another kind, a wrapper changes what the policy sees or commands, or the file cannot be written.

    Args:
        model: PPO or A2C of stable-baselines3 with an `MlpPolicy`, or a runner of rsl_rl with an `MLPModel`.
            Observations that `VecNormalize` or rsl_rl's `obs_normalization` normalise are normalised in the file too.
        envs: in which it was trained: a `PolicyEnv` or `PolicyVectorEnv`, whatever wrappers are around.
        output: the file (.onnx), which is replaced only by a whole one.

    Returns:
        The file's path.
    """
    from humanoid_sim.training.ppo.export import export  # noqa: PLC0415 - needs the libraries of training

    return export(model, envs, output)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `training` with command-line arguments; returns the exit status."""
    from humanoid_sim.command_line import Commands, parse  # noqa: PLC0415 - heavy imports stay out of importing this package

    config: TrainConfig | CurvesConfig = parse(
        Commands("Train a policy for any task.", {"train": TrainConfig, "curves": CurvesConfig}),
        "training",
        arguments,
        positional=True,
    )
    if isinstance(config, CurvesConfig):
        from humanoid_sim.training.ppo.journal import curves  # noqa: PLC0415 - needs no library of training

        return curves(config)
    from humanoid_sim.training.ppo.run import train  # noqa: PLC0415

    return train(config)
