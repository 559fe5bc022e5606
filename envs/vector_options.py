"""What a vector environment and its reset take, checked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.mit import FloatArray

__all__ = ["autoreset", "check_counts", "reset_command", "reset_mask", "reset_seeds"]


def reset_seeds(seed: int | Sequence[int | None] | None, count: int) -> Sequence[int | None]:
    """One seed per environment: `seed`, `seed + 1`, … of a number; None leaves an environment's stream as it is.

    Raises:
        InputError: there are more or fewer than environments.
    """
    if seed is None:
        return [None] * count
    if isinstance(seed, int | np.integer):
        return [int(seed) + i for i in range(count)]
    if len(seed) != count:
        raise InputError(f"reset: seed has {len(seed)} values, expected one number or {count}, one per environment")
    return [None if one is None else int(one) for one in seed]


def autoreset(mode: AutoresetMode | str) -> AutoresetMode:
    """The autoreset mode of that name.

    Raises:
        InputError: there is none.
    """
    try:
        return AutoresetMode(mode)
    except ValueError:
        accepted = " or ".join([", ".join(m.value for m in list(AutoresetMode)[:-1]), list(AutoresetMode)[-1].value])
        raise InputError(f"autoreset_mode: is {mode!r}, expected {accepted}") from None


def check_counts(num_envs: int, max_episode_steps: int | None) -> None:
    """Refuse numbers of environments and steps that are none.

    Raises:
        InputError: naming the option.
    """
    if isinstance(num_envs, bool) or num_envs < 1:
        raise InputError(f"num_envs: is {num_envs!r}, expected a whole number >= 1")
    if max_episode_steps is not None and max_episode_steps < 1:
        raise InputError(f"max_episode_steps: is {max_episode_steps!r}, expected a whole number >= 1 or None")


def reset_mask(mask: Any, count: int) -> npt.NDArray[np.bool_]:
    """The environments to reset, shape (count,); all where no mask is given.

    Raises:
        InputError: it is no such array, or chooses none.
    """
    if mask is None:
        return np.ones(count, dtype=np.bool_)
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (count,) or not mask.any():
        raise InputError(
            f"reset: reset_mask is {mask!r}, expected {count} booleans in an array, at least one of them true"
        )
    return mask


def reset_command(options: dict[str, Any], count: int) -> FloatArray | None:
    """The velocity commands, shape (count, 3), of the options that remain; None: the task's.

    Raises:
        InputError: it is not three finite numbers or that many per environment, or there is another option.
    """
    others = [name for name in options if name != "command"]
    if others:
        raise InputError(f"reset: {known_names('option', others[0], ('command', 'reset_mask'))}")
    if "command" not in options:
        return None
    try:
        command = np.asarray(options["command"], dtype=np.float64)
    except (TypeError, ValueError):
        command = np.empty(0)
    if command.shape not in ((3,), (count, 3)) or not np.isfinite(command).all():
        raise InputError(
            f"reset: command is {options['command']!r}, expected vx, vy and yaw rate: three finite numbers, or three "
            f"for each of {count} environments"
        )
    return np.broadcast_to(command, (count, 3))
