"""This machine's figures, as ratios to bare MuJoCo and ONNX Runtime where there is something bare to compare with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from humanoid_sim.cli import parse

__all__ = ["BenchOptions", "main"]


@dataclass(frozen=True)
class BenchOptions:
    """Measure this machine: what the control stack costs compared with the bare physics and inference it contains.

    Every figure is the median over repetitions. Ratios are taken pair by pair, the two sides in turn, so that a machine
    whose speed drifts drifts for both.
    """

    repetitions: int = 15
    """Number of times to take each figure."""
    only: str | None = None
    """Measure only the rows whose name contains this text."""
    json: bool = False
    """Print JSON instead of a table."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `tools.bench` with command-line arguments; returns the exit status."""
    options = parse(BenchOptions, "tools.bench", arguments)

    from tools.bench.figures import print_figures  # noqa: PLC0415 - MuJoCo stays out of `--help`

    return print_figures(options)
