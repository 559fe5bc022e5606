"""`regress`: read, run, compare, show it, write it down."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from importlib.metadata import version
from pathlib import Path
from time import perf_counter

import mujoco
import numpy as np
from msgspec.structs import replace
from rich.console import Console
from rich.progress import Progress

from humanoid_sim import __version__
from humanoid_sim.cli import ExitStatus, complain
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.evaluation.failure import DEFINITIONS
from humanoid_sim.files import whole_file
from humanoid_sim.regress.compare import FEW_SEEDS, fewest_seeds, judge
from humanoid_sim.regress.executors import LOCAL, Executor, ray_executor, run_locally
from humanoid_sim.regress.files import json_of, junit_xml, matching_baseline, read_baseline
from humanoid_sim.regress.options import RegressConfig, check_outputs
from humanoid_sim.regress.preparation import PreparedSuite, TestedPolicy, distinct_names, prepare_policy, prepare_suite
from humanoid_sim.regress.recordings import choose_failures, record_episode, recording_name
from humanoid_sim.regress.report import report_page
from humanoid_sim.regress.results import Candidate, PolicyRun, Results, SuiteInfo
from humanoid_sim.regress.show import say, show_candidate, show_run, show_verdict
from humanoid_sim.regress.suite import chosen_suite, load_suite

_RECORDINGS = Path("runs")
"""Folder in which --episode writes, unless --record-failures names one."""


def regress(config: RegressConfig) -> int:
    """Run policies over a suite; the exit status is 1 if one is worse than the baseline. Raises as `tested` does."""
    return ExitStatus.of(tested(config, Console(emoji=False)).passed)


def tested(config: RegressConfig, verdicts: Console) -> Results:
    """Run policies over a suite, write the files that were asked for, and print the verdicts on a console.

    Raises `InputError` if what was given cannot be used.
    """
    check_outputs(config)
    suite, folder = load_suite(config.suite)
    prepared = prepare_suite(chosen_suite(suite, config), folder, config.robot)
    contract = None if config.contract is None else Path(config.contract)
    checkpoint = config.baseline if config.baseline and config.baseline.endswith(".onnx") else None
    names = distinct_names([Path(path) for path in (*config.policies, checkpoint) if path is not None])
    policies = []
    for i, path in enumerate(config.policies):
        again = names[:i].count(names[i])
        name = f"{names[i]} ({again + 1})" if again else names[i]
        policies.append(prepare_policy(prepared, Path(path), contract, name))
    baseline: TestedPolicy | PolicyRun | None = None
    if config.baseline is not None:
        file = Path(config.baseline)
        if checkpoint is not None:
            baseline = prepare_policy(_for_baseline(prepared, config, folder), file, contract, names[-1])
        else:
            baseline = matching_baseline(prepared, read_baseline(file), config)
            if any(policy.name == baseline.name and policy.checkpoint.sha256 != baseline.sha256 for policy in policies):
                baseline = replace(baseline, name=file.stem)
    console = Console(quiet=config.quiet, emoji=False)  # a name such as ':a:' is not a picture
    with ExitStack() as stack:
        executor: Executor = partial(run_locally, threads=config.threads)
        if config.ray is not None:
            processors = config.threads if config.ray == LOCAL else None
            executor = stack.enter_context(ray_executor(config.ray, processors))
        results, seconds = _run(config, prepared, baseline, policies, executor, console)
    if config.episode is None:
        for candidate in results.candidates:
            show_verdict(verdicts, results, candidate)
            if results.baseline is not None and candidate.worse:
                say(console, _which_joints(results, candidate, results.baseline))
    documents: dict[Path | None, Callable[[], bytes]] = {
        config.write_baseline: lambda: json_of(results.candidates[0].run),
        config.json: lambda: json_of(results),
        config.junit: lambda: junit_xml(results, seconds),
        config.report: lambda: report_page(results).encode(),
    }
    _write(documents)
    if config.record_failures is not None or config.episode is not None:
        _record(config, prepared, policies, results, verdicts)
    return results


def _which_joints(results: Results, candidate: Candidate, baseline: PolicyRun) -> str:
    """Return how to see which joints are commanded differently: figures are over all joints, recordings hold each."""
    first = (*candidate.run.failures, *candidate.run.episodes)[0]
    command = ["regress", candidate.run.source, *results.arguments, "--episode", f"{first.case}:{first.seed}"]
    return f"joint by joint: {shlex.join(command)}; then replay its recording with --policy {baseline.source}"


def _for_baseline(prepared: PreparedSuite, config: RegressConfig, folder: Path) -> PreparedSuite:
    """Return the suite as a baseline runs it."""
    actuation = config.baseline_actuation or prepared.suite.actuation
    if actuation == prepared.suite.actuation:
        return prepared
    return prepare_suite(replace(prepared.suite, actuation=actuation), folder, config.robot)


def _run(
    config: RegressConfig,
    prepared: PreparedSuite,
    baseline: TestedPolicy | PolicyRun | None,
    policies: Sequence[TestedPolicy],
    executor: Executor,
    console: Console,
) -> tuple[Results, list[float]]:
    """Run the baseline, then the candidates; with the seconds that each took.

    The seconds are no part of the results: the same command gives the same results.
    """
    suite, cases = prepared.suite, policies[0].cases
    if isinstance(baseline, TestedPolicy):
        baseline = run_policy(baseline, executor, "" if config.quiet else "baseline")
    fewest = suite.seeds if baseline is None else min(suite.seeds, fewest_seeds(baseline))
    few = f"{fewest} seeds of each case are few, expected {FEW_SEEDS} or more: their intervals are wide and uncertain"
    options = {"--suite": config.suite, "--robot": config.robot, "--contract": config.contract}
    results = Results(
        suite=SuiteInfo(
            name=suite.name,
            summary=suite.summary,
            task=suite.task,
            robot=prepared.description.name,
            cases=tuple(case.name for case in suite.cases),
            seeds=suite.seed_numbers,
            duration=max(case.steps * case.scenario.contract.policy_dt for case in cases),
        ),
        metrics=suite.metrics,
        confidence=suite.confidence,
        resamples=suite.resamples,
        baseline=baseline,
        candidates=(),
        strict=config.strict,
        warnings=(few,) if baseline is not None and fewest < FEW_SEEDS else (),
        arguments=tuple(word for option, value in options.items() if value for word in (option, value)),
    )
    for warning in results.warnings:
        complain(f"warning: {warning}")
    seconds = []
    for policy in policies:
        begin = perf_counter()
        run = run_policy(policy, executor, "" if config.quiet else policy.name)
        candidate = judge(suite, baseline, run, strict=config.strict)
        seconds.append(perf_counter() - begin)
        results = replace(results, candidates=(*results.candidates, candidate))
        if baseline is None:
            show_run(console, results, candidate.run)
        else:
            show_candidate(console, results, candidate)
    return results, seconds


def run_policy(policy: TestedPolicy, executor: Executor, label: str = "") -> PolicyRun:
    """Run every episode of a policy; `label` is that of the progress on stderr."""
    suite = policy.prepared.suite
    with Progress(console=Console(stderr=True, emoji=False), transient=True, disable=not label) as bar:
        task = bar.add_task(label, total=len(suite.cases) * suite.seeds)
        episodes = executor(policy, lambda count: bar.advance(task, count))
    return PolicyRun(
        name=policy.name,
        source=policy.checkpoint.source,
        sha256=policy.checkpoint.sha256,
        suite=suite.name,
        case_digests=policy.prepared.digests,
        definitions=dict(DEFINITIONS),
        episodes=tuple(episodes),
        batching=policy.policy.batching,
        versions={
            "humanoid_sim": __version__,
            "mujoco": mujoco.__version__,
            "numpy": np.__version__,
            "onnxruntime": version("onnxruntime"),
            "python": platform.python_version(),
            "platform": platform.platform(),
        },
    )


def _record(
    config: RegressConfig, prepared: PreparedSuite, policies: Sequence[TestedPolicy], results: Results, console: Console
) -> None:
    """Record failing episodes, or the one that was asked for."""
    folder = config.record_failures or _RECORDINGS
    with blaming(f"--record-failures: '{folder}' cannot be made a folder", OSError):
        folder.mkdir(parents=True, exist_ok=True)
    for policy, candidate in zip(policies, results.candidates, strict=True):
        cases = {case.case.name: case for case in policy.cases}
        run = candidate.run
        for episode in run.episodes if config.episode else choose_failures(run.episodes, config.record_limit):
            path = folder / recording_name(run.name, episode)
            record_episode(path, cases[episode.case], episode, prepared.suite.disturbance)
            if config.episode or not config.quiet:
                say(console, f"recorded {path}")


def _write(documents: Mapping[Path | None, Callable[[], bytes]]) -> None:
    """Write all files that were asked for: what keeps one from being written keeps none of the others.

    Raises the first `InputError`.
    """
    problems = []
    for path, document in documents.items():
        if path is not None:
            try:
                with whole_file(path) as file:
                    file.write(document())
            except InputError as error:
                problems.append(error)
    if problems:
        raise problems[0]
