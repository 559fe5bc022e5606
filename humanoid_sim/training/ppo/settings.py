"""PPO's settings, the same for both libraries as far as both have them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract

__all__ = ["SETTINGS", "PPOSettings", "first_spread"]

_FIRST_SPREAD = {False: 0.2, True: 0.1}
"""rad by which a new network moves its joints at random, by whether the base is floating: enough to learn from (with
half of it the arms learn a quarter as fast to track), and little enough to stay up for a while."""


@dataclass(frozen=True)
class PPOSettings:
    """One PPO."""

    widths: tuple[int, ...] = (256, 128)
    """Of the hidden layers, of actor and critic each; ELU between them."""
    steps_per_update: int = 32
    """Of each robot."""
    epochs: int = 5
    minibatches: int = 4
    learning_rate: float = 5e-4
    """rsl_rl adapts it to `desired_kl`."""
    least_deviation: float = 0.2
    """Added to the observations' standard deviations, which normalise them: what hardly ever changed is not blown up
    when it does. Observations are of order one as they are."""
    gamma: float = 0.99
    gae_lambda: float = 0.95
    clip: float = 0.2
    entropy: float = 0.001
    value: float = 1.0
    largest_gradient: float = 1.0
    desired_kl: float = 0.02
    """Kullback-Leibler divergence of an update; at three times as much stable-baselines3 ends it early."""


SETTINGS = PPOSettings()


def first_spread(contract: PolicyContract, *, is_floating: bool) -> float:
    """Standard deviation of the raw actions of a new network."""
    return float(_FIRST_SPREAD[is_floating] / np.median(np.abs(contract.action_scale)))
