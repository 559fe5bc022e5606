"""Options of environments and their resets, checked; and the random numbers that their episodes start from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.mit import BoolArray, FloatArray, IndexArray

_EPISODES = 16
"""Number of episodes whose start numbers are drawn at a time."""


def reset_seeds(seed: int | Sequence[int | None] | None, count: int) -> Sequence[int | None]:
    """Return one seed per environment: `seed`, `seed + 1`, … of a number; None leaves an environment's stream as it is.

    Raises `InputError` if they are not whole numbers, or not as many as environments.
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
    """Return the autoreset mode of that name. Raises `InputError` if there is none."""
    try:
        return AutoresetMode(mode)
    except ValueError:
        accepted = " or ".join([", ".join(m.value for m in list(AutoresetMode)[:-1]), list(AutoresetMode)[-1].value])
        raise InputError(f"autoreset_mode: is {mode!r}, expected {accepted}") from None


def require_same_step(envs: VectorEnv[Any, Any, Any], library: str) -> None:
    """Refuse environments for a library that starts an episode in the step that ends the last one, unless they do too.

    Raises `InputError` if they start episodes another way.
    """
    mode = envs.metadata.get("autoreset_mode")
    if mode is not AutoresetMode.SAME_STEP:
        shown = mode.value if isinstance(mode, AutoresetMode) else mode
        raise InputError(f"autoreset_mode: is {shown!r}, expected 'SameStep' for {library}")


def term_means(info: Mapping[str, Any]) -> dict[str, float]:
    """Return each reward term's mean over the environments that had one in a step, by the step's `info`."""
    means: dict[str, float] = {}
    for entries in (info, info.get("final_info", {})):
        for name, values in entries.get("terms", {}).items():
            mask = entries["terms"].get(f"_{name}")
            if mask is not None and mask.any() and name not in means:
                means[name] = float(values[mask].mean())
    return means


def count_option(name: str, value: Any) -> int:
    """Return a number of environments or steps. Raises `InputError` if it is not one."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise InputError(f"{name}: is {value!r}, expected a whole number >= 1")
    return int(value)


def reset_mask(mask: Any, count: int) -> BoolArray:
    """Return the environments to reset, shape (count,); all where no mask is given.

    Raises `InputError` if it is not such an array, or chooses none.
    """
    if mask is None:
        return np.ones(count, dtype=np.bool_)
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (count,) or not mask.any():
        raise InputError(
            f"reset: reset_mask is {mask!r}, expected {count} booleans in an array, at least one of them true"
        )
    return mask


def velocity_option(value: Any, count: int | None = None) -> FloatArray:
    """Return vx, vy in m/s and yaw rate in rad/s, shape (3,); of `count` environments, (count, 3).

    Raises `InputError` if the option is not three finite numbers, nor that many for each of the environments.
    """
    try:
        command = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        command = np.empty(0)
    if command.shape not in ((3,), (count, 3)) or not np.isfinite(command).all():
        several = "" if count is None else f", or three for each of {count} environments"
        raise InputError(f"reset: command is {value!r}, expected vx, vy and yaw rate: three finite numbers{several}")
    return command if count is None else np.broadcast_to(command, (count, 3))


def refuse_others(options: Mapping[str, Any], *known: str) -> None:
    """Refuse options of a reset that nobody has taken. Raises `InputError` if there is one."""
    for name in options:
        raise InputError(f"reset: {known_names('option', name, known)}")


class StartNumbers:
    """Uniform numbers in [0, 1) for N environments, each from a stream of its own, drawn ahead for many episodes.

    An environment's are those that a single one draws from Gymnasium's `np_random` with the same seed: a generator
    gives the same numbers whether it is asked for one episode's or for a block of several.
    """

    def __init__(self, count: int, width: int) -> None:
        """Set up for `count` environments, a start of which takes `width` numbers."""
        self._generators: list[np.random.Generator | None] = [None] * count
        self.seeds = np.zeros(count, dtype=np.uint64)
        """Shape (N,), what the environments were last seeded with (of a longer seed the lowest 64 bits)."""
        self._blocks = np.zeros((count, _EPISODES, width))
        self._next = np.full(count, _EPISODES)

    def seed(self, indices: IndexArray, seeds: Sequence[int | None]) -> None:
        """Start streams anew.

        Args:
            indices: shape (k,), environments.
            seeds: k of them; None leaves a stream as it is, and draws a seed where there is none.
        """
        for i, seed in zip(indices.tolist(), seeds, strict=True):
            if seed is not None:
                self._start(i, seed)
            else:
                self._generator(i)

    def take(self, indices: IndexArray) -> FloatArray:
        """Return the numbers of the next start of each of these environments, shape (k, width)."""
        for i in indices[self._next[indices] == _EPISODES].tolist():
            self._blocks[i] = self._generator(i).random(self._blocks.shape[1:])
            self._next[i] = 0
        numbers: FloatArray = self._blocks[indices, self._next[indices]]
        self._next[indices] += 1
        return numbers

    def _generator(self, i: int) -> np.random.Generator:
        generator = self._generators[i]
        return self._start(i, None) if generator is None else generator

    def _start(self, i: int, seed: int | None) -> np.random.Generator:
        generator, used = seeding.np_random(seed)
        self._generators[i] = generator
        self.seeds[i] = used % 2**64
        self._next[i] = _EPISODES
        return generator
