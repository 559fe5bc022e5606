"""`regress`: read, run here or on a Ray cluster, compare, show it, write it down."""

from __future__ import annotations

import os
import platform
import socket
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import Any

import msgspec
from msgspec.structs import replace
from rich.console import Console
from rich.progress import track

from humanoid_sim import __version__
from humanoid_sim.assets import policy_path
from humanoid_sim.cli import ExitStatus
from humanoid_sim.errors import InputError, blaming, needing, reason_of
from humanoid_sim.files import output_file, regular_file, whole_file
from humanoid_sim.policy.checkpoint import Checkpoint
from humanoid_sim.policy_tools.show import make_console
from humanoid_sim.regress import RegressConfig
from humanoid_sim.regress.compare import compare_runs
from humanoid_sim.regress.episodes import run_episodes
from humanoid_sim.regress.preparation import PreparedCase, PreparedSuite, prepare_policy, prepare_suite
from humanoid_sim.regress.report import junit_xml, print_results, report_page
from humanoid_sim.regress.results import Candidate, Episode, PolicyRun, Results
from humanoid_sim.regress.suite import Suite, load_suite

_CHUNK = 8  # seeds of one task of a cluster
_FEWEST_SEEDS = 6  # of each case that a comparison takes: with fewer their spread is hardly known


def regress(config: RegressConfig) -> int:
    """Run policies over a suite and print the verdicts; the exit status is 1 if one is worse than the baseline."""
    results = tested(config)
    print_results(make_console(), results)
    return ExitStatus.of(results.passed)


def tested(config: RegressConfig) -> Results:
    """Run policies over a suite, and write the files that were requested.

    A policy's name is its file's, and the path as given where several have that.
    """
    if not config.policies:
        raise InputError("POLICIES: is empty, expected one or more ONNX checkpoints")
    for option, suffix in (("json", ".json"), ("junit", ".xml"), ("report", ".html")):
        if (output := getattr(config, option)) is not None:
            output_file(output, f"--{option}", suffix, overwrite=config.overwrite)
    suite, folder = load_suite(config.suite)
    prepared = prepare_suite(_chosen(suite, config), folder, config.robot)
    given, paths = list(config.policies), [policy_path(name, "POLICIES") for name in config.policies]
    baseline: PolicyRun | None = None
    if config.baseline is not None:
        compared = policy_path(config.baseline, "--baseline")
        if compared.suffix == ".onnx":
            given.append(config.baseline)
            paths.append(compared)
        else:
            baseline = stored_baseline(prepared, compared)
    policies = [prepare_policy(prepared, path, config.contract) for path in paths]
    stems = [path.stem for path in paths]
    names = [stem if stems.count(stem) == 1 else name for stem, name in zip(stems, given, strict=True)]
    with _cluster(config.ray) as ray:
        runs = [_run(name, prepared, cases, ray) for name, cases in zip(names, policies, strict=True)]
    if len(runs) > len(config.policies):
        baseline = runs.pop()
    candidates = tuple(Candidate(run=run, comparisons=compare_runs(prepared.suite, baseline, run)) for run in runs)
    results = Results(suite=prepared.suite, robot=prepared.description.name, baseline=baseline, candidates=candidates)
    for output, document in (
        (config.json, msgspec.json.format(msgspec.json.encode(results), indent=1) + b"\n"),
        (config.junit, junit_xml(results)),
        (config.report, report_page(results).encode()),
    ):
        if output is not None:
            with whole_file(output) as file:
                file.write(document)
    return results


def _chosen(suite: Suite, config: RegressConfig) -> Suite:
    """Return the suite with the options' cases and seeds."""
    names = ", ".join(case.name for case in suite.cases)
    cases = tuple(case for case in suite.cases if config.only is None or config.only in case.name)
    if not cases:
        raise InputError(f"--only: is '{config.only}', expected part of one of the suite's cases: {names}")
    seeds = suite.seeds if config.seeds is None else config.seeds
    if seeds < (1 if config.baseline is None else _FEWEST_SEEDS):
        raise InputError(f"--seeds: is {seeds}, expected at least 1, and {_FEWEST_SEEDS} with a --baseline")
    return replace(suite, cases=cases, seeds=seeds)


def _run(name: str, prepared: PreparedSuite, cases: Sequence[PreparedCase], ray: Any) -> PolicyRun:
    """Run a policy's episodes case by case and seed by seed: in this process without Ray, with the same results."""
    packages = {name: version(name) for name in ("mujoco", "numpy", "onnxruntime")}
    local = (run_episodes(case, range(case.suite.seeds)) for case in cases)
    running = local if ray is None else _run_on_ray(ray, prepared, cases[0].checkpoint)
    episodes = tuple(chain.from_iterable(track(running, name, console=Console(stderr=True), transient=True)))
    return PolicyRun(
        name=name,
        source=cases[0].checkpoint.source,
        sha256=cases[0].checkpoint.sha256,
        case_digests=prepared.digests,
        episodes=episodes,
        versions={"humanoid_sim": __version__, **packages, "platform": platform.platform()},
    )


@contextmanager
def _cluster(address: str | None) -> Iterator[Any]:
    """Yield Ray, connected to a cluster; None without an address.

    The package, the checkpoint and the robot's files must be at the same paths on every machine of it.
    """
    if address is None:
        yield None
        return
    with needing("ray", "cluster", "--ray"):
        import ray  # noqa: PLC0415 - an extra, and slow to import
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    local = {"include_dashboard": False} if address == "local" else {}
    host, _, port = address.rpartition(":")
    with blaming(f"--ray: is '{address}', and no cluster answers there", (OSError, ValueError, RuntimeError)):
        if port.isdigit() and "/" not in host:  # Ray itself tries for minutes, and then ends the process
            socket.create_connection((host, int(port)), timeout=5.0).close()
        ray.init(address, log_to_driver=False, logging_level="error", **local)
    try:
        yield ray
    finally:
        ray.shutdown()


def _run_on_ray(ray: Any, prepared: PreparedSuite, checkpoint: Checkpoint) -> Iterator[list[Episode]]:
    task, suite, contract = ray.remote(num_cpus=1)(run_seeds), prepared.suite, checkpoint.contract_file
    parcel = ray.put((prepared, Path(checkpoint.source).resolve(), contract and contract.resolve()))
    seeds = [range(suite.seeds)[at : at + _CHUNK] for at in range(0, suite.seeds, _CHUNK)]
    for running in [task.remote(parcel, i, chunk) for i in range(len(suite.cases)) for chunk in seeds]:
        yield ray.get(running)


def run_seeds(parcel: tuple[PreparedSuite, Path, Path | None], i: int, seeds: Sequence[int]) -> list[Episode]:
    """Run some seeds of a suite's case `i`, as a worker of a cluster does."""
    return run_episodes(prepare_policy(*parcel)[i], seeds, threads=1)


def stored_baseline(prepared: PreparedSuite, path: Path) -> PolicyRun:
    """Return the first policy of a file of `--json`, with the episodes that the suite's cases are compared with."""
    data = regular_file(path, "a baseline: a file of --json, or a checkpoint (.onnx)").read_bytes()
    try:
        baseline = msgspec.json.decode(data, type=Results).candidates[0].run
    except (msgspec.DecodeError, IndexError) as error:
        raise InputError(f"{path}: is not a file of `regress --json`: {reason_of(error)}") from None
    episodes = tuple(episode for episode in baseline.episodes if episode.case in prepared.digests)
    for name, digest in prepared.digests.items():
        seeds = {episode.seed for episode in episodes if episode.case == name}
        if baseline.case_digests.get(name) != digest or not seeds >= set(range(prepared.suite.seeds)):
            differ = baseline.case_digests.get(name, digest) != digest
            had = "its conditions differ" if differ else f"it has {len(seeds)} of {prepared.suite.seeds} seeds"
            raise InputError(f"{path}: is no baseline for case '{name}': {had}; make it again with --json")
    return replace(baseline, episodes=episodes)
