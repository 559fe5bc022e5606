"""The options of `regress`, and which of them are refused. Nothing heavy is imported here: `--help` must be quick."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from humanoid_sim.assets import policy_path
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
    actuation: Literal["affine", "implicit"] | None = None
    """Simulation of the motors. Default: as the suite says, which is affine unless it says otherwise."""
    baseline_actuation: Literal["affine", "implicit"] | None = None
    """The same for a --baseline that is run. Give a policy as its own baseline to see what a plant changes. Default:
    as for the others."""
    seeds: int | None = None
    """Seeds per case. Default: the suite's."""
    first_seed: int | None = None
    """The first of them. Default: the suite's."""
    only: Annotated[str | None, tyro.conf.arg(metavar="TEXT")] = None
    """Run only the cases whose name contains this text."""
    strict: bool = False
    """Also fail what the seeds are too few to decide: what is unclear, or worse and perhaps beyond tolerance."""
    episode: Annotated[str | None, tyro.conf.arg(metavar="CASE:SEED")] = None
    """CASE:SEED: run nothing but this episode of each policy and write it as a recording, whether it fails or not, to
    --record-failures, or to runs."""
    write_baseline: Path | None = None
    """Write what the first policy did to this file (.json), for --baseline."""
    json: Path | None = None
    """Write everything that was found to this file."""
    junit: Path | None = None
    """Write the verdicts to this file as JUnit XML, with times, for continuous integration."""
    report: Path | None = None
    """Write a report to this file: one self-contained page (.html)."""
    record_failures: Path | None = None
    """Write failing episodes to this folder, as recordings (.mcap) for `replay`. Recordings of
    the same policy, case and seed are replaced."""
    record_limit: int = 10
    """Recordings per policy at most, the first of each case before the second of any."""
    threads: int | None = None
    """Threads that step physics. Default: one per processor."""
    ray: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None
    """Share the episodes out over a Ray cluster: its address, or 'local' to start one here."""
    overwrite: bool = False
    """Replace output files that exist."""
    quiet: bool = False
    """Print verdicts only."""


def with_files(config: RegressConfig) -> RegressConfig:
    """Return the options with the files of policies that are given by their names.

    Raises `InputError` if there is no such policy, or its file cannot be an ONNX file.
    """
    from humanoid_sim.policy.onnx_policy import check_file  # noqa: PLC0415 - NumPy stays out of `--help`

    policies = tuple(str(policy_path(policy, "POLICIES")) for policy in config.policies)
    for path in policies:
        check_file(Path(path))
    baseline = config.baseline and str(policy_path(config.baseline, "--baseline"))
    return replace(config, policies=policies, baseline=baseline)


_OUTPUTS = ("write_baseline", "json", "junit", "report")


def check_outputs(config: RegressConfig) -> None:
    """Refuse outputs that could not be written at the end of a long run. Raises `InputError`, naming the option."""
    if not config.policies:
        raise InputError("POLICIES: is empty, expected one or more ONNX checkpoints")
    if config.episode is not None:
        case, _, seed = config.episode.rpartition(":")
        if not case or not seed.isdecimal():
            raise InputError(f"--episode: is '{config.episode}', expected CASE:SEED, such as wave:3")
        idle = ("baseline", "seeds", "first_seed", "only", "strict", *_OUTPUTS)
        for name in idle:
            if getattr(config, name):
                option = name.replace("_", "-")
                raise InputError(f"--{option}: has no effect with --episode, which judges nothing; leave one out")
    if config.baseline_actuation is not None and not (config.baseline or "").endswith(".onnx"):
        what = "no --baseline is given" if config.baseline is None else f"--baseline is '{config.baseline}'"
        raise InputError(f"--baseline-actuation: {what}, expected a checkpoint (.onnx) that is run")
    suffixes = {"junit": ".xml", "report": ".html"}
    files = {f"--{name.replace('_', '-')}": (getattr(config, name), suffixes.get(name, ".json")) for name in _OUTPUTS}
    named: dict[Path, str] = {}
    for option, (path, suffix) in files.items():
        if path is None:
            continue
        output_file(path, option, suffix, overwrite=config.overwrite)
        other = named.setdefault(path.absolute(), option)
        if other != option:
            raise InputError(f"{option}: is '{path}', as {other} is; expected different files")
    folder = config.record_failures
    if folder is not None and folder.exists() and not folder.is_dir():
        raise InputError(f"--record-failures: '{folder}' is a file, expected a folder")
    for name, number in (("--record-limit", config.record_limit), ("--threads", config.threads)):
        if number is not None and number < 1:
            raise InputError(f"{name}: is {number}, expected a whole number >= 1")
