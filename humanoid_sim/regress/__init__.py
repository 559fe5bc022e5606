"""Is this checkpoint worse than that one? Rollouts over a suite, compared metric by metric.

Nothing heavy is imported here: `--help` must be quick.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro

from humanoid_sim.assets import policy_path
from humanoid_sim.cli import parse
from humanoid_sim.errors import InputError
from humanoid_sim.files import output_file


@dataclass(frozen=True)
class RegressConfig:
    """Run policies over a suite and compare them, metric by metric, with a baseline.

    Exit status 0: no metric of any policy is worse than the baseline by more than the suite tolerates, over all cases
    or in one, and no episode failed in a way in which none of the baseline's did. 1: otherwise. 2: something that was
    given cannot be used.
    """

    policies: tuple[str, ...]
    """ONNX checkpoints under test, or shipped policies."""
    suite: str = "lite_tracking"
    """A shipped suite, or the path of a suite's YAML file."""
    baseline: Annotated[str | None, tyro.conf.arg(metavar="FILE")] = None
    """Policy to compare with: an ONNX checkpoint or a shipped policy, which is run too, or a file of --write-baseline.
    Default: nothing."""
    robot: str | None = None
    """Instead of the suite's: a shipped robot, robot_descriptions:NAME, or the path of a robot's
    YAML file or of an MJCF."""
    contract: Annotated[str | None, tyro.conf.arg(metavar="FILE.yaml")] = None
    """A contract.yaml for all the checkpoints. Default: the one beside each."""
    seeds: int | None = None
    """Seeds per case. Default: the suite's."""
    only: Annotated[str | None, tyro.conf.arg(metavar="TEXT")] = None
    """Run only the cases whose name contains this text."""
    write_baseline: Path | None = None
    """Write what the first policy did to this file (.json), for --baseline."""
    json: Path | None = None
    """Write everything that was found to this file."""
    junit: Path | None = None
    """Write the verdicts to this file as JUnit XML, for continuous integration."""
    report: Path | None = None
    """Write a report to this file: one self-contained page (.html)."""
    threads: int | None = None
    """Threads that step physics. Default: one per processor."""
    ray: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None
    """Share the episodes out over a Ray cluster: its address, or 'local' to start one here."""
    overwrite: bool = False
    """Replace output files that exist."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `regress` with command-line arguments; returns the exit status."""
    config = checked(parse(RegressConfig, "regress", arguments, positional=True))

    from humanoid_sim.regress.run import regress  # noqa: PLC0415

    return regress(config)


def checked(config: RegressConfig) -> RegressConfig:
    """Return the options with the paths of shipped policies in place of their names."""
    if not config.policies:
        raise InputError("POLICIES: is empty, expected one or more ONNX checkpoints")
    for name, suffix in (("write_baseline", ".json"), ("json", ".json"), ("junit", ".xml"), ("report", ".html")):
        output = getattr(config, name)
        if output is not None:
            output_file(output, f"--{name.replace('_', '-')}", suffix, overwrite=config.overwrite)
    policies = tuple(str(policy_path(policy, "POLICIES")) for policy in config.policies)
    baseline = config.baseline and str(policy_path(config.baseline, "--baseline"))
    return replace(config, policies=policies, baseline=baseline)
