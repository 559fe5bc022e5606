"""The random numbers of a batch: of each environment a function of its seed, its episode and the step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray, IndexArray, IntArray
from humanoid_sim.simulation.batch.randomisation import NEUTRAL, Randomisation

Words = npt.NDArray[np.uint64]

_MULTIPLIERS = (np.uint64(0xD2511F53), np.uint64(0xCD9E8D57))
_KEY_STEPS = (np.uint64(0x9E3779B9), np.uint64(0xBB67AE85))
_LOW = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(32)
_ROUNDS = 10


def philox(counter: Words, key: Words) -> Words:
    """Return random words, shape (4, ...), as a function of key and counter: nothing depends on the batch.

    Philox4x32-10 (Salmon, Moraes, Dror, Shaw 2011, "Parallel random numbers: as easy as 1, 2, 3"), for many keys at
    once. A generator object per environment would need a Python loop in every step.

    Args:
        counter: shape (4, ...), 32-bit words.
        key: shape (2, ...), 32-bit words, broadcast against the counter's.
    """
    c0, c1, c2, c3 = counter
    k0, k1 = key
    for _ in range(_ROUNDS):
        first, second = c0 * _MULTIPLIERS[0], c2 * _MULTIPLIERS[1]
        c0, c1, c2, c3 = (second >> _HALF) ^ c1 ^ k0, second & _LOW, (first >> _HALF) ^ c3 ^ k1, first & _LOW
        k0, k1 = (k0 + _KEY_STEPS[0]) & _LOW, (k1 + _KEY_STEPS[1]) & _LOW
    return np.stack(np.broadcast_arrays(c0, c1, c2, c3))


def seed_keys(seeds: npt.ArrayLike) -> Words:
    """Keys of shape (2, N) from seeds of shape (N,), whole numbers below 2⁶⁴."""
    words = np.asarray(seeds, dtype=np.uint64)
    return np.stack([words & _LOW, words >> _HALF])


def uniforms(keys: Words, stream: int, counter: npt.NDArray[np.integer], width: int) -> FloatArray:
    """Uniform numbers in (0, 1), shape (N, width).

    Args:
        keys: shape (2, N), from `seed_keys`.
        stream: what the numbers are for; different streams are independent.
        counter: shape (N,), >= 0, such as the number of a step; different counters are independent.
        width: numbers per environment.
    """
    return uniforms_of_streams(keys, [(stream, width)], counter)[0]


def uniforms_of_streams(
    keys: Words, streams: Sequence[tuple[int, int]], counter: npt.NDArray[np.integer]
) -> list[FloatArray]:
    """Say what `uniforms` gives of each of several streams and widths, all at once: most of the cost is of the call."""
    blocks = [-(-width // 4) for _, width in streams]
    count = keys.shape[1]
    words = np.empty((4, count, sum(blocks)), dtype=np.uint64)
    words[0] = np.concatenate([np.arange(n, dtype=np.uint64) for n in blocks])
    step = counter.astype(np.uint64)[:, None]
    words[1] = step & _LOW
    words[2] = step >> _HALF
    words[3] = np.repeat(np.array([stream for stream, _ in streams], dtype=np.uint64), blocks)
    drawn = philox(words, keys[:, :, None])
    flat = (drawn.transpose(1, 2, 0).reshape(count, -1).astype(np.float64) + 0.5) * 2.0**-32
    begins = 4 * np.cumsum([0, *blocks])
    return [flat[:, begin : begin + width] for begin, (_, width) in zip(begins[:-1], streams, strict=True)]


def normals(keys: Words, stream: int, counter: npt.NDArray[np.integer], width: int) -> FloatArray:
    """Return standard normal numbers, shape (N, width), by Box and Muller; arguments as of `uniforms`."""
    half = -(-width // 2)
    drawn = uniforms(keys, stream, counter, 2 * half)
    radius = np.sqrt(-2.0 * np.log(drawn[:, :half]))
    angle = 2.0 * np.pi * drawn[:, half:]
    return np.concatenate([radius * np.cos(angle), radius * np.sin(angle)], axis=1)[:, :width]


_STREAMS = {
    "mass": 1,
    "friction": 2,
    "joint_friction": 3,
    "stiffness": 4,
    "damping": 5,
    "command_delay": 6,
    "armature": 7,
    "centre_of_mass": 8,
    "payload": 9,
    "motor_strength": 10,
    "effort_limit": 11,
    "state_delay": 12,
    "joint_position_bias": 13,
    "orientation_bias": 14,
    "angular_velocity_bias": 15,
    "linear_acceleration_bias": 16,
    "gravity_tilt": 17,
    "jitter": 32,
    "noise": 33,
    "push": 34,
}
"""Stream of random numbers that each quantity is drawn from: what one is set to does not move the others."""
_ONE_VALUE = "friction", "command_delay", "state_delay"
_JOINT_BY_JOINT = (
    "joint_friction",
    "armature",
    "stiffness",
    "damping",
    "motor_strength",
    "effort_limit",
    "joint_position_bias",
)
_AXIS_BY_AXIS = "orientation_bias", "angular_velocity_bias", "linear_acceleration_bias"
_EPISODE = 32
"""Bits of a counter below the number of the episode."""


class Draws:
    """Random numbers for N environments. Each episode's are drawn anew; those of the first are the seed's."""

    def __init__(
        self, randomisation: Randomisation, count: int, *, joints: int = 0, bodies: int = 0, carriers: int = 0
    ) -> None:
        """Set up `count` environments, which are to be seeded; `carriers` is how many bodies carry payload."""
        self.randomisation = randomisation
        """The ranges."""
        self._keys = seed_keys(np.zeros(count, dtype=np.uint64))
        self._episode = np.zeros(count, dtype=np.int64)
        widths = {
            "mass": bodies,
            "centre_of_mass": 3 * bodies,
            "payload": carriers,
            **dict.fromkeys(_ONE_VALUE, 1),
            **dict.fromkeys(_JOINT_BY_JOINT, joints),
            **dict.fromkeys(_AXIS_BY_AXIS, 3),
            "gravity_tilt": 2,
        }
        self._widths = widths
        self._shares = {
            name: np.zeros((count, width)) for name, width in widths.items() if randomisation.has(name) and width
        }

    def seed(self, indices: IndexArray, seeds: npt.ArrayLike) -> None:
        """Begin the first episode of these seeds, shape (k,) or (), whole numbers in [0, 2⁶⁴)."""
        self._keys[:, indices] = seed_keys(np.broadcast_to(np.asarray(seeds, dtype=np.uint64), indices.shape))
        self._episode[indices] = 0
        self._draw(indices)

    def next_episode(self, indices: IndexArray) -> None:
        """Begin the next episode of these environments."""
        self._episode[indices] += 1
        self._draw(indices)

    def _draw(self, indices: IndexArray) -> None:
        if not self._shares or not len(indices):
            return
        streams = [(_STREAMS[name], shares.shape[1]) for name, shares in self._shares.items()]
        drawn = uniforms_of_streams(self._keys[:, indices], streams, self._counter(indices, 0))
        for shares, fresh in zip(self._shares.values(), drawn, strict=True):
            shares[indices] = fresh

    def ranged(self, name: str, indices: IndexArray) -> FloatArray:
        """Values of a range in its unit, shape (k, w); where nothing differs a factor is 1, and anything else is 0."""
        if name not in self._shares:
            return np.full((len(indices), self._widths[name]), NEUTRAL[name][0])
        low, high = getattr(self.randomisation, name)
        drawn: FloatArray = low + (high - low) * self._shares[name][indices]
        return drawn

    def symmetric(self, name: str, indices: IndexArray) -> FloatArray:
        """Values within ± the field, in its unit, shape (k, w)."""
        if name not in self._shares:
            return np.zeros((len(indices), self._widths[name]))
        values: FloatArray = getattr(self.randomisation, name) * (2.0 * self._shares[name][indices] - 1.0)
        return values

    def turned(self, name: str, indices: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Return an angle up to the field, and a direction in [0, 2 π), each of shape (k,), rad."""
        if name not in self._shares:
            return np.zeros(len(indices)), np.zeros(len(indices))
        angle, direction = self._shares[name][indices].T
        return getattr(self.randomisation, name) * angle, 2.0 * np.pi * direction

    def shares(self, name: str, part: npt.NDArray[np.integer], width: int) -> FloatArray:
        """Uniform numbers in (0, 1), shape (N, width), for part number `part`, (N,), of all environments' episodes."""
        return uniforms(self._keys, _STREAMS[name], self._counter(slice(None), part), width)

    def normal(self, name: str, step: IntArray, width: int) -> FloatArray:
        """Return standard normal numbers, shape (N, width), for the steps (N,) of all environments' episodes."""
        return normals(self._keys, _STREAMS[name], self._counter(slice(None), step), width)

    def _counter(self, indices: IndexArray | slice, part: npt.ArrayLike) -> IntArray:
        counter: IntArray = (self._episode[indices] << _EPISODE) + np.asarray(part, dtype=np.int64)
        return counter

    def snapshot(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies, for `restore` of as many environments."""
        return {"keys": self._keys.copy(), "episode": self._episode.copy()}

    def restore(self, snapshot: Mapping[str, npt.NDArray[Any]]) -> None:
        """Take over a snapshot."""
        self._keys[:], self._episode[:] = snapshot["keys"], snapshot["episode"]
        self._draw(np.arange(len(self._episode)))
