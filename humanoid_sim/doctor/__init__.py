"""Find out what is wired wrongly in a policy that does not behave: try what usually is, one change at a time, and see.

`hypotheses` is the space of changes, `rollout` tries one in simulation, `search` goes through them, `report` tells.
"""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `policy doctor` with command-line arguments; returns the exit status: 0 if nothing wrong was found."""
    import tyro  # noqa: PLC0415 - heavy imports stay out of `--help` and of importing this package

    from humanoid_sim.doctor.config import DoctorConfig  # noqa: PLC0415

    config = tyro.cli(DoctorConfig, prog="humanoid_sim.policy doctor", args=arguments)

    from humanoid_sim.doctor.program import doctor  # noqa: PLC0415

    return doctor(config)
