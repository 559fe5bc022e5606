"""What a vector environment and its reset take, checked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.mit import FloatArray

__all__ = ["autoreset", "count_option", "reset_command", "reset_mask", "reset_seeds"]


def reset_seeds(seed: int | Sequence[int | None] | None, count: int) -> Sequence[int | None]:
    """One seed per environment: `seed`, `seed + 1`, … of a number; None leaves an environment's stream as it is.

    Raises:
        InputError: they are not whole numbers, or not as many as environments.
    """
    if seed is None:
        return [None] * count
    seeds = [seed + i for i in range(count)] if isinstance(seed, int | np.integer) else seed
    if not isinstance(seeds, Sequence | np.ndarray) or len(seeds) != count or not all(map(_is_seed, seeds)):
        raise InputError(
            f"reset: seed is {seed!r}, expected a whole number >= 0, or {count} of them, one per environment"
        )
    return [None if one is None else int(one) for one in seeds]


def _is_seed(value: Any) -> bool:
    return value is None or (isinstance(value, int | np.integer) and bool(value >= 0))


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


def count_option(name: str, value: Any) -> int:
    """A number of environments or steps.

    Raises:
        InputError: it is none.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise InputError(f"{name}: is {value!r}, expected a whole number >= 1")
    return int(value)


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
