"""`python -m humanoid_sim.prepare`: a checkpoint and a motion from elsewhere become files that `play` runs."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `prepare` with command-line arguments; returns the exit status."""
    import tyro  # noqa: PLC0415 - heavy imports stay out of `--help` and of importing this package

    from humanoid_sim.prepare.config import PrepareConfig  # noqa: PLC0415

    config = tyro.cli(PrepareConfig, prog="humanoid_sim.prepare", args=arguments)

    from humanoid_sim.prepare.program import prepare  # noqa: PLC0415

    return prepare(config)
