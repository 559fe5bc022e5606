"""`regress`: read, run, compare, show it, write it down."""

from __future__ import annotations

import platform
from contextlib import ExitStack
from functools import partial
from importlib.metadata import version
from pathlib import Path

import msgspec
from msgspec.structs import replace
from rich.console import Console
from rich.progress import Progress

from humanoid_sim import __version__
from humanoid_sim.cli import ExitStatus
from humanoid_sim.errors import InputError, known_names, reason_of
from humanoid_sim.evaluation.failure import DEFINITIONS, differing
from humanoid_sim.files import regular_file, whole_file
from humanoid_sim.regress.compare import compare_runs
from humanoid_sim.regress.executors import Advance, Executor, ray_executor, run_locally
from humanoid_sim.regress.options import RegressConfig
from humanoid_sim.regress.preparation import PreparedSuite, TestedPolicy, prepare_policy, prepare_suite
from humanoid_sim.regress.report import junit_xml, report_page, verdict_lines
from humanoid_sim.regress.results import Candidate, PolicyRun, Results
from humanoid_sim.regress.suite import chosen_suite, load_suite

_AGAIN = "make it again with --write-baseline"


def regress(config: RegressConfig) -> int:
    """Run policies over a suite and print the verdicts; the exit status is 1 if one is worse than the baseline."""
    results = tested(config)
    for candidate in results.candidates:
        print(*verdict_lines(results, candidate), sep="\n")
    return ExitStatus.of(results.passed)


def tested(config: RegressConfig) -> Results:
    """Run policies over a suite, and write the files that were asked for.

    Raises `InputError` if what was given cannot be used.
    """
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
    with ExitStack() as stack:
        executor: Executor = partial(run_locally, threads=config.threads)
        if config.ray is not None:
            executor = stack.enter_context(ray_executor(config.ray, config.threads))
        console = Console(stderr=True, emoji=False)
        bar = stack.enter_context(Progress(console=console, transient=True, disable=not console.is_terminal))
        runs = []
        for policy in policies:
            task = bar.add_task(policy.name, total=len(policy.cases) * prepared.suite.seeds)
            runs.append(run_policy(policy, executor, partial(bar.advance, task)))
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


def run_policy(policy: TestedPolicy, executor: Executor, advance: Advance) -> PolicyRun:
    """Run every episode of a policy."""
    packages = {name: version(name) for name in ("mujoco", "numpy", "onnxruntime")}
    return PolicyRun(
        name=policy.name,
        source=policy.checkpoint.source,
        sha256=policy.checkpoint.sha256,
        suite=policy.prepared.suite.name,
        case_digests=policy.prepared.digests,
        definitions=dict(DEFINITIONS),
        episodes=tuple(executor(policy, advance)),
        versions={"humanoid_sim": __version__, **packages, "platform": platform.platform()},
    )


def json_of(value: msgspec.Struct) -> bytes:
    """Return a result as JSON, indented, such that a difference of two files can be read."""
    return msgspec.json.format(msgspec.json.encode(value), indent=1) + b"\n"


def stored_baseline(prepared: PreparedSuite, path: Path) -> PolicyRun:
    """Return the part of a file of `--write-baseline` that the suite's cases are compared with.

    Raises `InputError` if it is no such file, lacks a case, a seed or a metric of the suite, or was run under other
    conditions or definitions.
    """
    data = regular_file(path, "a baseline (.json) or a checkpoint (.onnx)").read_bytes()
    try:
        baseline = msgspec.json.decode(data, type=PolicyRun)
    except msgspec.DecodeError as error:
        raise InputError(f"{path}: is not a baseline of `regress --write-baseline`: {reason_of(error)}") from None
    others = differing(baseline.definitions)
    if others:
        raise InputError(f"{path}: was made with other definitions than today's ({', '.join(others)}); {_AGAIN}")
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
        if not of_case.keys() >= set(prepared.suite.seed_numbers):
            raise InputError(f"{path}: has the seeds {min(of_case)} to {max(of_case)}; see --seeds and --first-seed")
    lacking = [metric.name for metric in prepared.suite.metrics if metric.name not in episodes[0].metrics]
    if lacking:
        raise InputError(f"{path}: was made before {', '.join(lacking)} could be measured; {_AGAIN}")
    return replace(baseline, episodes=episodes, case_digests=prepared.digests)
