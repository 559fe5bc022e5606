"""A delay line: values stamped with the physics step at which they were taken, seen a fixed number of steps later."""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

from humanoid_sim.errors import InputError

T = TypeVar("T")

LONGEST_DELAY = 10.0
"""s; far more than any bus, and few enough steps to keep."""


class DelayLine(Generic[T]):
    """Delayed view of a stream of samples that take `delay` steps to reach the observer."""

    def __init__(self, delay: int) -> None:
        self._delay = delay
        self._samples: deque[tuple[int, T]] = deque()

    def restart(self, step: int, value: T) -> None:
        """Forget everything; `value` is seen at once."""
        self._samples.clear()
        self._samples.append((step, value))

    def push(self, step: int, value: T) -> None:
        """Add a sample taken at `step`, which is not before the previous one's."""
        self._samples.append((step, value))

    def at(self, step: int) -> tuple[int, T]:
        """Return the latest sample that has arrived at `step`, and when it was taken. `step` must not go back."""
        samples = self._samples
        while len(samples) > 1 and samples[1][0] + self._delay <= step:
            samples.popleft()
        return samples[0]


def delay_steps(name: str, delay: float, physics_timestep: float) -> int:
    """Return a delay in physics steps; both times in s.

    Raises:
        InputError: negative, longer than `LONGEST_DELAY`, or not a multiple of the physics step; the message names the
            nearest that is.
    """
    if not 0.0 <= delay <= LONGEST_DELAY:
        raise InputError(f"{name}: is {delay:g} s, expected 0 to {LONGEST_DELAY:g} s")
    steps = round(delay / physics_timestep)
    if abs(delay - steps * physics_timestep) > 1e-9:
        raise InputError(
            f"{name}: {delay:g} s is not a multiple of the physics step of {physics_timestep:g} s; the nearest is "
            f"{steps * physics_timestep:g} s"
        )
    return steps
