"""This machine's figures, as ratios to bare MuJoCo and ONNX Runtime where there is something bare to compare with."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `bench` with command-line arguments; returns the exit status."""
    import tyro  # noqa: PLC0415 - heavy imports stay out of importing this package

    from humanoid_sim.bench.config import BenchConfig  # noqa: PLC0415

    config = tyro.cli(BenchConfig, prog="humanoid_sim.bench", args=arguments)

    from humanoid_sim.bench.program import bench  # noqa: PLC0415

    return bench(config)
