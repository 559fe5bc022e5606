"""Train legs on robots and ground that grow harder: randomisation, terrain and commands on a curriculum.

    pip install -c constraints.txt -e '.[rl]'
    python examples/growing_harder.py --steps 5000000

It shows where the environments' `progress` is set. `python -m humanoid_sim.training train --robot lite_biped --terrain
mixed --curriculum examples/growing_harder.py:harder` sets it for you. Neither is claimed to walk:
`make train-walking` makes the policy that does.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

import humanoid_sim  # noqa: F401 - registers the environments
from humanoid_sim.cli import run_program
from humanoid_sim.command_line import parse
from humanoid_sim.envs.stable_baselines import StableBaselinesVecEnv

RANDOMISATION = {
    "mass": (0.9, 1.1),
    "payload": (0.0, 1.0),
    "friction": (0.6, 1.2),
    "motor_strength": (0.9, 1.1),
    "joint_position_bias": 0.01,
    "orientation_bias": 0.02,
    "state_delay": (0.0, 0.01),
    "push": (0.0, 0.4),
}


def harder(progress: float) -> dict[str, float]:
    """Commands first, then differences between robots; pushes and rougher ground from the middle on."""
    late = max(0.0, 2.0 * progress - 1.0)
    return {
        "commands": min(1.0, 0.3 + progress),
        "randomisation": min(1.0, 2.0 * progress),
        "push": late,
        "terrain": late,
    }


class Progress(BaseCallback):
    """Tells the environments how far training has come: it holds for the episodes that begin from then on."""

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        done = self.num_timesteps / self.model._total_timesteps
        self.training_env.set_attr("progress", min(done, 1.0))


def make_envs(count: int, terrain: str) -> Any:
    """Return the legs, many times."""
    return gymnasium.make_vec(
        "humanoid_sim/BipedVelocity-v0",
        num_envs=count,
        actuation="implicit",
        terrain=terrain,
        randomisation=RANDOMISATION,
        curriculum=harder,
        autoreset_mode="SameStep",
    )


@dataclass(frozen=True)
class Options:
    """Train legs on robots and ground that grow harder."""

    steps: int = 5_000_000
    """Environment steps."""
    envs: int = 128
    """Environments at a time."""
    terrain: str = "mixed"
    """flat, rough, slopes, steps or mixed."""
    output: str = "growing_harder.zip"
    """The trained network."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Train, and save the network."""
    options = parse(Options, "examples/growing_harder.py", arguments)
    envs = make_envs(options.envs, options.terrain)
    model = PPO("MlpPolicy", StableBaselinesVecEnv(envs), n_steps=24, batch_size=24 * options.envs // 4, verbose=1)
    model.learn(options.steps, callback=Progress())
    model.save(options.output)
    envs.close()
    return 0


if __name__ == "__main__":
    sys.exit(run_program(main))
