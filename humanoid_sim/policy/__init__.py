"""Checkpoints and motions: reading what a policy needs, and running it outside the pure part.

As a program, `python -m humanoid_sim.policy`, it shows, checks, stamps and diagnoses checkpoints.
"""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `policy` with command-line arguments; returns the exit status."""
    from humanoid_sim.policy.cli import main as program  # noqa: PLC0415 - importing the package must stay quick

    return program(arguments)
