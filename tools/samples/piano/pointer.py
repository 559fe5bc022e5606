"""The network and its view of a song and of the hands: it points each hand at a key, or at none.

Of each key that the next second asks for it sees when it begins and ends, how far it is from each hand, how soon that
is free, and whether the key is down; what it makes of all of them is pooled, so that it sees each among the others. The
keys' order plays no part.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch
from torch import nn

from humanoid_sim.mit import FloatArray
from tools.samples.piano.hands import FAR

__all__ = ["FEATURES", "LOOKAHEAD", "OFFSETS", "Pointer", "key_features", "times"]

LOOKAHEAD = (*range(1, 13), *range(14, 31, 2), *range(35, 61, 5))
"""Steps ahead at which the goals are seen: all of the near ones, few of the far ones."""
OFFSETS = np.array([0, *LOOKAHEAD], dtype=np.float64)
FEATURES = 18
_WIDTH = 48


def times(seen: npt.NDArray[np.floating]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return when each key begins, ends, and begins again, in steps; `FAR` for never.

    Args:
        seen: shape (..., T, 88), 0 or 1, the goals at `OFFSETS`.

    Returns:
        Shape (..., 88) each; a key that should be down now begins at 0.
    """
    ahead = OFFSETS[:, None]
    wait = (ahead + FAR * (1.0 - seen)).min(axis=-2)
    released = (1.0 - seen) * (ahead > wait[..., None, :])
    left = (ahead + FAR * (1.0 - released)).min(axis=-2)
    asked = seen * (ahead > left[..., None, :])
    return wait, left, (ahead + FAR * (1.0 - asked)).min(axis=-2)


def key_features(
    wait: FloatArray, left: FloatArray, again: FloatArray, pressed: FloatArray, hands: FloatArray
) -> FloatArray:
    """Return what the network sees of each key, shape (..., 88, FEATURES).

    Args:
        wait: shape (..., 88), steps until it begins.
        left: shape (..., 88), steps until it ends.
        again: shape (..., 88), steps until it begins once more.
        pressed: shape (..., 88), 1 where it is down.
        hands: shape (..., 2, 3), of each hand: the key that it is over or goes to, the steps until it is free to do
            anything else, and how deep it is, from 0 over the key to 1 on its bottom.
    """
    keys = np.arange(88.0)
    away = (keys[:, None] - hands[..., None, :, 0]) / 20.0
    near = np.minimum(wait, 60.0)
    columns = [
        wait == 0.0,
        np.exp(-near / 6.0),
        np.exp(-near / 20.0),
        near / 60.0,
        np.exp(-np.minimum(left, 60.0) / 6.0),
        np.minimum(left, 60.0) / 60.0,
        np.exp(-np.minimum(again, 60.0) / 6.0),
        np.minimum(again, 60.0) / 60.0,
        np.broadcast_to(keys / 44.0 - 1.0, wait.shape),
        *(away[..., hand] for hand in (0, 1)),
        *(np.abs(away[..., hand]) for hand in (0, 1)),
        *(np.broadcast_to(hands[..., hand, 1, None] / 10.0, wait.shape) for hand in (0, 1)),
        *(np.broadcast_to(hands[..., hand, 2, None], wait.shape) for hand in (0, 1)),
        pressed,
    ]
    return np.stack([np.asarray(column, dtype=np.float64) for column in columns], axis=-1)


class Pointer(nn.Module):
    """Scores of keys for each hand, and of none."""

    def __init__(self) -> None:
        super().__init__()
        self.each = nn.Sequential(nn.Linear(FEATURES, _WIDTH), nn.ReLU(), nn.Linear(_WIDTH, _WIDTH), nn.ReLU())
        self.among = nn.Sequential(nn.Linear(2 * _WIDTH, _WIDTH), nn.ReLU(), nn.Linear(_WIDTH, 2))
        self.none = nn.Sequential(nn.Linear(_WIDTH, _WIDTH), nn.ReLU(), nn.Linear(_WIDTH, 2))

    def forward(self, features: torch.Tensor, asked: torch.Tensor) -> torch.Tensor:
        """Scores, shape (B, C + 1, 2): of C keys for each hand, and of none as the last.

        Args:
            features: shape (B, C, FEATURES).
            asked: shape (B, C), 1 for keys that the song asks for within what is seen, 0 for the others.
        """
        each = self.each(features) * asked[..., None]
        pooled = each.amax(dim=1)
        scores = self.among(torch.cat([each, pooled[:, None].expand_as(each)], dim=-1))
        scores = scores - (1.0 - asked[..., None]) * 1e4
        return torch.cat([scores, self.none(pooled)[:, None]], dim=1)
