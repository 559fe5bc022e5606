"""The stages in which the walking policy is trained, and what differs between the robots meanwhile."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

from humanoid_sim.assets import asset_path

__all__ = ["CONTRACT", "QUICK", "RANDOMISATION", "STAGES", "TIMESTEP", "Stage"]

CONTRACT = asset_path("policies", "lite_biped_velocity.contract.yaml")
"""That the policy is trained under."""
TIMESTEP = 0.005
"""s, of the implicit plant: the longest that divides the policy's period well, four physics steps."""

RANDOMISATION: Mapping[str, Any] = MappingProxyType(
    {
        "mass": (0.9, 1.1),
        "friction": (0.6, 1.8),
        "joint_friction": (0.5, 1.5),
        "stiffness": (0.93, 1.07),
        "damping": (0.9, 1.1),
        "command_delay": (0.0, 0.01),
        "joint_position_noise": 0.005,
        "joint_velocity_noise": 0.08,
        "angular_velocity_noise": 0.03,
        "orientation_noise": 0.008,
    }
)
"""Fields of `humanoid_sim.simulation.batch.Randomisation`; the soles' friction is 0.36 to 1.08."""


@dataclass(frozen=True)
class Stage:
    """One run of PPO."""

    name: str
    steps: int
    """Policy steps of all robots together."""
    robots: int = 256
    steps_per_update: int = 24
    batch: int = 1536
    epochs: int = 5
    learning_rate: float = 5e-4
    entropy: float = 0.001
    push: float = 0.3
    """m/s of the strongest force on the base, as of `play --push`."""
    velocity_push: float = 0.0
    """m/s of the strongest change of the whole robot's velocity; if there are both, either comes half of the time."""
    push_interval: float = 5.0
    """s, on average."""
    spread: float | None = None
    """Standard deviation of the actions that it begins with; None: what the stage before came to."""
    mean_of: tuple[str, ...] = ()
    """Stages whose networks' mean it begins with; none: the stage before."""
    weights: Mapping[str, float] = field(default_factory=lambda: {"alive": 3.0})
    """Weights of reward terms, 1/s, beside the task's own."""


_SHARP = {"alive": 3.0, "linear_velocity": 8.0, "yaw_rate": 3.0}
_EASY = {**_SHARP, "strain": -60.0}
_EXACT = {"alive": 3.0, "linear_velocity": 10.0, "yaw_rate": 5.0, "strain": -30.0}
_FAST = {"alive": 3.0, "linear_velocity": 16.0, "yaw_rate": 8.0, "strain": -30.0}
_PUSHED = {"alive": 3.0, "linear_velocity": 16.0, "yaw_rate": 8.0, "strain": -60.0}

STAGES = (
    Stage("step", 2_400_000, robots=512, steps_per_update=32, batch=4096, epochs=4, learning_rate=7e-4),
    Stage("stay up", 2_700_000, learning_rate=6e-4),
    Stage("go", 2_000_000, entropy=0.002, spread=0.18),
    Stage("hold a speed", 1_500_000, entropy=0.0, push=0.15, spread=0.15, weights=_SHARP),
    Stage("spare the motors", 2_700_000, entropy=0.0, push=0.4, spread=0.13, weights=_EASY),
    Stage("be exact", 1_300_000, entropy=0.0, push=0.2, spread=0.12, weights=_EXACT),
    Stage("hurry", 750_000, learning_rate=7e-4, entropy=0.0, push=0.15, spread=0.13, weights=_FAST),
    Stage("settle", 480_000, batch=3072, learning_rate=3e-4, entropy=0.0, push=0.2, spread=0.1, weights=_FAST),
    Stage("be pushed", 2_550_000, entropy=0.0, velocity_push=0.6, push_interval=4.0, spread=0.12, weights=_PUSHED),
    Stage(
        "be pushed harder",
        1_920_000,
        entropy=0.0,
        push=0.45,
        velocity_push=0.7,
        push_interval=4.0,
        spread=0.12,
        weights=_PUSHED,
    ),
    Stage("mean", 0, mean_of=("settle", "be pushed", "be pushed harder")),
)
"""Stages in which the shipped policy was trained; the first ones need no speed, they learn not to fall."""

QUICK = tuple(replace(stage, steps=2 * 8 * 4, robots=8, steps_per_update=4, batch=16, epochs=1) for stage in STAGES)
"""The same with two updates each."""
