"""The options of `bench`."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["BenchConfig"]


@dataclass(frozen=True)
class BenchConfig:
    """Measure this machine: what the control stack costs beside the bare physics and the bare inference in it.

    Every figure is the median over repetitions. Ratios are taken pair by pair, the two sides in turn, so that a machine
    whose speed drifts drifts for both.
    """

    repetitions: int = 15
    """How often each figure is taken."""
    only: str | None = None
    """Measure only the rows whose name contains this text."""
    json: bool = False
    """Print JSON instead of a table."""
