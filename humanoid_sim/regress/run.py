"""`regress`: read, run here or on a Ray cluster, compare, show it, write it down."""

from __future__ import annotations

import dataclasses
import os
import platform
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
from msgspec.structs import replace
from rich.console import Console
from rich.progress import Progress

from humanoid_sim import __version__
from humanoid_sim.cli import ExitStatus
from humanoid_sim.errors import InputError, blaming, known_names, needing, reason_of
from humanoid_sim.files import regular_file, whole_file
from humanoid_sim.regress import RegressConfig
from humanoid_sim.regress.compare import compare_runs
from humanoid_sim.regress.episodes import run_episodes
from humanoid_sim.regress.preparation import PreparedSuite, TestedPolicy, prepare_policy, prepare_suite
from humanoid_sim.regress.report import junit_xml, report_page, verdict_lines
from humanoid_sim.regress.results import Candidate, Episode, PolicyRun, Results
from humanoid_sim.regress.suite import chosen_suite, load_suite

Executor = Callable[[TestedPolicy], Iterator[list[Episode]]]  # case by case, seed by seed, as they end
_CHUNK = 8  # seeds of one task of a cluster
_AGAIN = "make it again with --write-baseline"


def regress(config: RegressConfig) -> int:
    """Run policies over a suite and print the verdicts; the exit status is 1 if one is worse than the baseline."""
    results = tested(config)
    for candidate in results.candidates:
        print(*verdict_lines(results, candidate), sep="\n")
    return ExitStatus.of(results.passed)


def tested(config: RegressConfig) -> Results:
    """Run policies over a suite, and write the files that were requested."""
    suite, folder = load_suite(config.suite)
    prepared = prepare_suite(chosen_suite(suite, config), folder, config.robot)
    contract = None if config.contract is None else Path(config.contract)
    stems = [Path(path).stem for path in config.policies]
    policies = []
    for path, stem in zip(config.policies, stems, strict=True):
        name = stem if stems.count(stem) == 1 else path
        policies.append(prepare_policy(prepared, Path(path), contract, name))
    baseline: PolicyRun | None = None
    if config.baseline is not None and config.baseline.endswith(".onnx"):
        policies.append(prepare_policy(prepared, Path(config.baseline), contract, "baseline"))
    elif config.baseline is not None:
        baseline = stored_baseline(prepared, Path(config.baseline))
    runs = _run_all(policies, config)
    if len(runs) > len(config.policies):
        baseline = runs.pop()
    compared = [() if baseline is None else compare_runs(prepared.suite, baseline, run) for run in runs]
    candidates = tuple(Candidate(run=run, comparisons=c) for run, c in zip(runs, compared, strict=True))
    results = Results(suite=prepared.suite, robot=prepared.description.name, baseline=baseline, candidates=candidates)
    for output, document in (
        (config.write_baseline, json_of(runs[0])),
        (config.json, json_of(results)),
        (config.junit, junit_xml(results)),
        (config.report, report_page(results).encode()),
    ):
        if output is not None:
            with whole_file(output) as file:
                file.write(document)
    return results


def _run_all(policies: Sequence[TestedPolicy], config: RegressConfig) -> list[PolicyRun]:
    packages = {name: version(name) for name in ("mujoco", "numpy", "onnxruntime")}
    versions = {"humanoid_sim": __version__, **packages, "platform": platform.platform()}
    console, runs = Console(stderr=True, emoji=False), []
    with (
        _executor(config) as executor,
        Progress(console=console, transient=True, disable=not console.is_terminal) as bar,
    ):
        for policy in policies:
            suite, episodes = policy.prepared.suite, list[Episode]()
            task = bar.add_task(policy.name, total=len(policy.cases) * suite.seeds)
            for done in executor(policy):
                episodes += done
                bar.advance(task, len(done))
            runs.append(
                PolicyRun(
                    name=policy.name,
                    source=policy.checkpoint.source,
                    sha256=policy.checkpoint.sha256,
                    suite=suite.name,
                    case_digests=policy.prepared.digests,
                    episodes=tuple(episodes),
                    versions=versions,
                )
            )
    return runs


@contextmanager
def _executor(config: RegressConfig) -> Iterator[Executor]:
    """Yield what runs a policy's episodes: this process, or a Ray cluster, with the same results.

    On a cluster the package, the checkpoint and the robot's files must be at the same paths on every machine.
    """
    address = config.ray
    if address is None:
        yield lambda policy: (run_episodes(c, range(c.suite.seeds), threads=config.threads) for c in policy.cases)
        return
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host and port.isdecimal():  # Ray itself would try for minutes
        with blaming(f"--ray: is '{address}', and nobody answers there", (OSError, OverflowError)):
            socket.create_connection((host, int(port)), timeout=5.0).close()
    with needing("ray", "cluster", "--ray"):
        import ray  # noqa: PLC0415 - an extra, and slow to import
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    local = {"num_cpus": config.threads, "include_dashboard": False} if address == "local" else {}
    with blaming(f"--ray: is '{address}', and no cluster answers there", (ConnectionError, ValueError, RuntimeError)):
        ray.init(address, log_to_driver=False, logging_level="error", **local)
    try:
        yield partial(_run_on_ray, ray)
    finally:
        ray.shutdown()


def _run_on_ray(ray: Any, policy: TestedPolicy) -> Iterator[list[Episode]]:
    suite, task = policy.prepared.suite, ray.remote(num_cpus=1)(run_seeds)
    file, contract = Path(policy.checkpoint.source).resolve(), policy.checkpoint.contract_file
    parcel = ray.put((policy.prepared, file, contract and contract.resolve()))
    seeds = [range(suite.seeds)[at : at + _CHUNK] for at in range(0, suite.seeds, _CHUNK)]
    for running in [task.remote(parcel, i, chunk) for i in range(len(suite.cases)) for chunk in seeds]:
        yield ray.get(running)


def run_seeds(parcel: tuple[PreparedSuite, Path, Path | None], i: int, seeds: Sequence[int]) -> list[Episode]:
    """Run some seeds of a suite's case `i`, as a worker of a cluster does."""
    prepared, file, contract = parcel
    one = replace(prepared.suite, cases=prepared.suite.cases[i : i + 1])
    (case,) = prepare_policy(dataclasses.replace(prepared, suite=one), file, contract).cases
    return run_episodes(case, seeds, threads=1)


def json_of(value: msgspec.Struct) -> bytes:
    """Return a result as JSON, indented, such that a difference of two files can be read."""
    return msgspec.json.format(msgspec.json.encode(value), indent=1) + b"\n"


def stored_baseline(prepared: PreparedSuite, path: Path) -> PolicyRun:
    """Return the part of a file of `--write-baseline` that the suite's cases are compared with."""
    data = regular_file(path, "a baseline (.json) or a checkpoint (.onnx)").read_bytes()
    try:
        baseline = msgspec.json.decode(data, type=PolicyRun)
    except msgspec.DecodeError as error:
        raise InputError(f"{path}: is not a baseline of `regress --write-baseline`: {reason_of(error)}") from None
    episodes = tuple(episode for episode in baseline.episodes if episode.case in prepared.digests)
    for name, digest in prepared.digests.items():
        of_case = {episode.seed: episode for episode in episodes if episode.case == name}
        if not of_case:
            raise InputError(f"{path}: {known_names('case', name, baseline.case_digests)}")
        if baseline.case_digests.get(name) != digest:
            raise InputError(
                f"{path}: its case '{name}' was run under other conditions: suite, motion or robot have changed since; "
                + _AGAIN
            )
        if not of_case.keys() >= set(range(prepared.suite.seeds)):
            raise InputError(f"{path}: has the seeds {min(of_case)} to {max(of_case)}; see --seeds")
    lacking = [metric.name for metric in prepared.suite.metrics if metric.name not in episodes[0].metrics]
    if lacking:
        raise InputError(f"{path}: was made before {', '.join(lacking)} could be measured; {_AGAIN}")
    return replace(baseline, episodes=episodes, case_digests=prepared.digests)
