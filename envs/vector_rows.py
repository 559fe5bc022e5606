"""Rows of a batch: some environments' part of what all of them have."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.policy_step import PolicyMemory
from humanoid_sim.controllers.reference import Alignment
from humanoid_sim.mit import MITState

__all__ = ["memory_with", "state_rows"]

IndexArray = npt.NDArray[np.intp]
Scalar = TypeVar("Scalar", bound=np.generic)


def state_rows(state: MITState, indices: IndexArray) -> MITState:
    """The reports of k of the N robots."""
    arrays = {f.name: getattr(state, f.name)[indices] for f in fields(state) if f.name != "extern"}
    live = {name: replace(value, value=value.value[indices]) for name, value in state.extern.items()}
    return MITState(**arrays, extern=live)


def memory_with(memory: PolicyMemory, indices: IndexArray, rows: PolicyMemory) -> PolicyMemory:
    """A memory of N robots with those of k of them replaced.

    Args:
        memory: shape (N, …).
        indices: shape (k,).
        rows: shape (k, …).
    """
    alignment = memory.alignment
    if alignment is not None and rows.alignment is not None:
        alignment = Alignment(
            _with(alignment.yaw, indices, rows.alignment.yaw), _with(alignment.offset, indices, rows.alignment.offset)
        )
    history = memory.history
    if history is not None and rows.history is not None:
        history = _with(history, indices, rows.history)
    return PolicyMemory(
        frame=_with(np.asarray(memory.frame), indices, rows.frame),
        last_action=_with(memory.last_action, indices, rows.last_action),
        history=history,
        walked=_with(np.asarray(memory.walked), indices, rows.walked),
        alignment=alignment,
    )


def _with(array: npt.NDArray[Scalar], indices: IndexArray, rows: npt.ArrayLike) -> npt.NDArray[Scalar]:
    changed = array.copy()
    changed[indices] = rows
    return changed
