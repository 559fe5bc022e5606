"""The info of a vector environment, merged from its environments' as Gymnasium merges them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["VectorInfo"]

BoolArray = npt.NDArray[np.bool_]
Array = npt.NDArray[np.generic]


class VectorInfo:
    """Arrays over N environments by key, each with a mask `_key` of those that have it; zero where one has not."""

    def __init__(self, count: int) -> None:
        self._count = count
        self.entries: dict[str, Any] = {}
        """What `step` and `reset` return."""

    def add(self, key: str, values: Array, mask: BoolArray) -> None:
        """Add an entry of the environments in the mask, unless there are none; `values` is shape (N, …)."""
        if mask.any():
            shaped = mask.reshape(-1, *[1] * (values.ndim - 1))
            self.entries[key] = np.where(shaped, values, np.zeros((), dtype=values.dtype))
            self.entries[f"_{key}"] = mask.copy()

    def merge(self, key: str, values: Array, mask: BoolArray) -> None:
        """Add to an entry those of further environments."""
        if key in self.entries:
            known = self.entries[f"_{key}"]
            chosen = mask.reshape(-1, *[1] * (values.ndim - 1))
            values, mask = np.where(chosen, values, self.entries[key]), mask | known
        self.add(key, values, mask)

    def add_terms(self, key: str, terms: Mapping[str, Array], mask: BoolArray, owners: BoolArray) -> None:
        """Add a dictionary of values: all `owners` have one, it is empty outside of `mask`."""
        if owners.any():
            inner = VectorInfo(self._count)
            for name, values in terms.items():
                inner.add(name, values, mask)
            self.entries[key], self.entries[f"_{key}"] = inner.entries, owners.copy()

    def add_texts(self, key: str, texts: Mapping[int, str]) -> None:
        """Add texts by environment, unless there are none."""
        if texts:
            values, mask = np.full(self._count, None, dtype=object), np.zeros(self._count, dtype=np.bool_)
            for i, text in texts.items():
                values[i], mask[i] = text, True
            self.entries[key], self.entries[f"_{key}"] = values, mask

    def with_final(self, over: BoolArray, observation: Array) -> VectorInfo:
        """The info of a step that starts the next episodes of some environments.

        Args:
            over: shape (N,), whose entries here belong to the episodes that have ended.
            observation: shape (N, …), the last of those episodes.

        Returns:
            With `final_obs` and `final_info` of the episodes that have ended, and everything else of the others.
        """
        following = VectorInfo(self._count)
        following.entries = _part(self.entries, ~over)
        final = np.full(self._count, None, dtype=object)
        for i in np.flatnonzero(over):
            final[i] = observation[i].copy()
        following.entries |= {
            "final_obs": final,
            "_final_obs": over,
            "final_info": _part(self.entries, over),
            "_final_info": over,
        }
        return following


def _part(entries: Mapping[str, Any], kept: BoolArray) -> dict[str, Any]:
    """The entries of some of the environments."""
    part: dict[str, Any] = {}
    for key, value in entries.items():
        mask = entries.get(f"_{key}")
        if mask is None or not (mask & kept).any():
            continue
        remaining = mask & kept
        if isinstance(value, dict):
            part[key] = _part(value, kept)
        else:
            shaped = remaining.reshape(-1, *[1] * (value.ndim - 1))
            part[key] = np.where(shaped, value, None if value.dtype == object else np.zeros((), dtype=value.dtype))
        part[f"_{key}"] = remaining
    return part
