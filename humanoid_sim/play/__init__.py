"""The main program: run a policy on a robot, simulated or real, walked there through the five-mode FSM."""

from __future__ import annotations

from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `play` with command-line arguments; returns the exit status."""
    from humanoid_sim.cli import parse  # noqa: PLC0415 - heavy imports stay out of importing this package
    from humanoid_sim.play.options import PlayConfig  # noqa: PLC0415

    config = parse(PlayConfig, "play", arguments)

    from humanoid_sim.rendering import check_environment  # noqa: PLC0415

    check_environment()

    from humanoid_sim.play.console import PlayConsole  # noqa: PLC0415
    from humanoid_sim.play.run import played  # noqa: PLC0415

    return played(config, PlayConsole()).status
