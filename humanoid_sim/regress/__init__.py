"""Is this checkpoint worse than that one? Rollouts over a suite, compared metric by metric."""

from __future__ import annotations

from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `regress` with command-line arguments; returns the exit status."""
    from humanoid_sim.cli import parse  # noqa: PLC0415 - heavy imports stay out of importing this package
    from humanoid_sim.regress.options import RegressConfig, checked  # noqa: PLC0415

    config = checked(parse(RegressConfig, "regress", arguments, positional=True))

    from humanoid_sim.regress.run import regress  # noqa: PLC0415

    return regress(config)
