"""How the sample policy and the sample motions are made, and measured: `python -m humanoid_sim.training`."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `training` with command-line arguments; returns the exit status."""
    from humanoid_sim.training.__main__ import main as program  # noqa: PLC0415 - heavy imports stay out of this package

    return program(arguments)
