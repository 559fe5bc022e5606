"""Random numbers as a function of (seed, stream, counter): nothing to advance, so nothing depends on the batch.

Philox4x32-10 (Salmon, Moraes, Dror, Shaw 2011, "Parallel random numbers: as easy as 1, 2, 3"), for many keys at once.
A generator object per environment would need a Python loop in every step.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray

Words = npt.NDArray[np.uint64]

_MULTIPLIERS = (np.uint64(0xD2511F53), np.uint64(0xCD9E8D57))
_KEY_STEPS = (np.uint64(0x9E3779B9), np.uint64(0xBB67AE85))
_LOW = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(32)
_ROUNDS = 10


def philox(counter: Words, key: Words) -> Words:
    """Ten rounds.

    Args:
        counter: shape (4, ...), 32-bit words.
        key: shape (2, ...), 32-bit words, broadcast against the counter's.

    Returns:
        Shape (4, ...), 32-bit words.
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
    """What `uniforms` gives of each of several streams and widths, all at once: most of the cost is of the call."""
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
    """Standard normal numbers, shape (N, width), by Box and Muller; arguments as of `uniforms`."""
    half = -(-width // 2)
    drawn = uniforms(keys, stream, counter, 2 * half)
    radius = np.sqrt(-2.0 * np.log(drawn[:, :half]))
    angle = 2.0 * np.pi * drawn[:, half:]
    return np.concatenate([radius * np.cos(angle), radius * np.sin(angle)], axis=1)[:, :width]
