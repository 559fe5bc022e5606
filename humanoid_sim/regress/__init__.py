"""Is this checkpoint worse than that one? Rollouts over a suite, compared metric by metric.

Nothing heavy is imported here: `--help` must be quick.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from humanoid_sim.cli import parse


@dataclass(frozen=True)
class RegressConfig:
    """Run policies over a suite and compare them, metric by metric, with a baseline.

    Exit status 0: of every policy, no metric is worse than the baseline, in the mean over the cases, by more than the
    suite tolerates and not by chance, and no episode failed in a way in which none of its case in the baseline did. 1:
    otherwise. 2: something that was given cannot be used.
    """

    policies: tuple[str, ...]
    """ONNX checkpoints under test, or shipped policies."""
    suite: str = "lite_tracking"
    """A shipped suite, or the path of a suite's YAML file."""
    baseline: Annotated[str | None, tyro.conf.arg(metavar="FILE")] = None
    """Policy to compare with: an ONNX checkpoint or a shipped policy, which is run too, or a file of --json, whose
    first policy it is. Default: nothing."""
    robot: str | None = None
    """Instead of the suite's: a shipped robot, robot_descriptions:NAME, or the path of a robot's
    YAML file or of an MJCF."""
    contract: Path | None = None
    """A contract.yaml for all the checkpoints. Default: the one beside each."""
    seeds: int | None = None
    """Seeds per case. Default: the suite's."""
    only: Annotated[str | None, tyro.conf.arg(metavar="TEXT")] = None
    """Run only the cases whose name contains this text."""
    json: Path | None = None
    """Write everything that was found to this file (.json), which --baseline takes."""
    junit: Path | None = None
    """Write the verdicts to this file as JUnit XML, for continuous integration."""
    report: Path | None = None
    """Write the table to this file: one self-contained page (.html)."""
    ray: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None
    """Share the episodes out over a Ray cluster: its address, or 'local' to start one here."""
    overwrite: bool = False
    """Replace output files that exist."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `regress` with command-line arguments; returns the exit status."""
    config = parse(RegressConfig, "regress", arguments, positional=True)

    from humanoid_sim.regress.run import regress  # noqa: PLC0415

    return regress(config)
