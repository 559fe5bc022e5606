"""Changes what decides about motion, one small thing at a time, and tells which changes no test notices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from humanoid_sim.command_line import parse

__all__ = ["MutationConfig", "main"]


@dataclass(frozen=True)
class MutationConfig:
    """Change a sign, a number, a comparison, a statement or the order of two arguments, and run the mirrored tests.

    Each change is made in a copy of the tree. A change that no test notices survives: it is printed with its file and
    line, and the exit status is 1, unless `tools/mutation/equivalent.yaml` says why it changes nothing.
    """

    count: int = 60
    """Number of changes, chosen at random, as many in each part."""
    seed: int = 0
    """Seed of the choice, which stays as it is where the source does, whatever is written elsewhere."""
    part: tuple[str, ...] = ()
    """Parts to change: mit, controllers, session, adapter, protocols, plants. Default: all."""
    list: bool = False
    """List the changes only."""
    jobs: int = 2
    """Number of tests that run at once."""
    remember: bool = False
    """Write down which test notices which change; it is run first next time (`tools/mutation/killers.yaml`)."""

    EXAMPLES: ClassVar[tuple[tuple[str, str], ...]] = (
        ("--count 10 --seed 7 --part adapter", "ten changes of the motors' adapter that were not tried yet"),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `tools.mutation` with command-line arguments; returns the exit status."""
    config = parse(MutationConfig, "tools.mutation", arguments)

    from tools.mutation.campaign import campaign  # noqa: PLC0415 - `--help` reads no source

    return campaign(config)
