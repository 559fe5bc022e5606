"""`regress`: read, run, compare, show it, write it down."""

from __future__ import annotations

import platform
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from importlib.metadata import version
from pathlib import Path

import mujoco
import numpy as np
from msgspec.structs import replace
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from humanoid_sim import __version__
from humanoid_sim.cli import ExitStatus
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.definitions import DEFINITIONS
from humanoid_sim.files import whole_file
from humanoid_sim.regress.compare import detectable_changes, judge
from humanoid_sim.regress.executors import LOCAL, Advance, Executor, LocalExecutor, RayExecutor
from humanoid_sim.regress.files import matching_baseline, read_baseline, write_json, write_junit
from humanoid_sim.regress.margins import measure_margins
from humanoid_sim.regress.options import RegressConfig, check_outputs
from humanoid_sim.regress.preparation import PreparedSuite, TestedPolicy, prepare_policy, prepare_suite, unique_names
from humanoid_sim.regress.recordings import choose_failures, record_episode, recording_name
from humanoid_sim.regress.report import report_page, require_report
from humanoid_sim.regress.results import PolicyRun, Results, SuiteInfo
from humanoid_sim.regress.show import show_candidate, show_detectable, show_run, show_verdict
from humanoid_sim.regress.suite_file import chosen_suite, load_suite

__all__ = ["regress", "run_policy"]


def regress(config: RegressConfig) -> int:
    """Run policies over a suite; the exit status is 1 if one is worse than the baseline.

    Raises:
        InputError: if what was given cannot be used.
    """
    check_outputs(config)
    if config.report is not None:
        require_report()
    suite, folder = load_suite(config.suite)
    prepared = prepare_suite(chosen_suite(suite, config), folder, config.robot)
    contract = None if config.contract is None else Path(config.contract)
    policies = unique_names([prepare_policy(prepared, Path(path), contract) for path in config.policies])
    baseline: TestedPolicy | PolicyRun | None = None
    if config.baseline is not None and config.baseline.endswith(".onnx"):
        baseline = prepare_policy(prepared, Path(config.baseline), contract)
    elif config.baseline is not None:
        baseline = matching_baseline(prepared.digests, read_baseline(Path(config.baseline)), config)
    console = Console(quiet=config.quiet, emoji=False)  # a name such as ':a:' is no picture
    with ExitStack() as stack:
        executor: Executor = LocalExecutor(config.threads)
        if config.ray is not None:
            processors = config.threads if config.ray == LOCAL else None
            executor = stack.enter_context(closing(RayExecutor(config.ray, processors)))
        results = _run(config, prepared, baseline, policies, executor, console)
    plain = Console(emoji=False)
    for candidate in results.candidates:
        show_verdict(plain, results, candidate)
    _write(config, results)
    if config.record_failures is not None:
        _record(config.record_failures, config.record_limit, prepared, policies, results, console)
    return ExitStatus.of(results.passed)


def _run(
    config: RegressConfig,
    prepared: PreparedSuite,
    baseline: TestedPolicy | PolicyRun | None,
    policies: Sequence[TestedPolicy],
    executor: Executor,
    console: Console,
) -> Results:
    """The baseline first, then what it can tell apart, then the candidates."""
    suite, cases = prepared.suite, policies[0].cases
    if isinstance(baseline, TestedPolicy):
        baseline = _run_with_bar(config, prepared, baseline, executor, "baseline")
    results = Results(
        suite=SuiteInfo(
            name=suite.name,
            summary=suite.summary,
            task=suite.task,
            robot=prepared.description.name,
            cases=tuple(case.name for case in suite.cases),
            seeds=suite.seed_numbers,
            duration=max(case.steps * case.scenario.contract.policy_dt for case in cases),
            policy_dt=min(case.scenario.contract.policy_dt for case in cases),
        ),
        metrics=suite.metrics,
        confidence=suite.confidence,
        resamples=suite.resamples,
        baseline=baseline,
        detectable=() if baseline is None else detectable_changes(suite, suite.metrics, baseline),
        candidates=(),
    )
    show_detectable(console, results)
    for policy in policies:
        candidate = judge(suite, baseline, _run_with_bar(config, prepared, policy, executor, policy.name))
        results = replace(results, candidates=(*results.candidates, candidate))
        if baseline is None:
            show_run(console, results, candidate.run)
        else:
            show_candidate(console, results, candidate)
    return results


def _run_with_bar(
    config: RegressConfig, prepared: PreparedSuite, policy: TestedPolicy, executor: Executor, label: str
) -> PolicyRun:
    """With a bar on stderr, if a person is watching."""
    suite, stderr = prepared.suite, Console(stderr=True)
    levels = sum(len(sweep.levels) for sweep in suite.margins.sweeps) if config.margins and suite.margins else 0
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=stderr, transient=True, disable=config.quiet or not stderr.is_terminal) as bar:
        task = bar.add_task(label, total=len(suite.cases) * suite.seeds + levels)
        return run_policy(prepared, policy, executor, config.margins, lambda count: bar.advance(task, count))


def run_policy(
    prepared: PreparedSuite,
    policy: TestedPolicy,
    executor: Executor,
    margins: bool = False,
    advance: Advance = lambda _: None,
) -> PolicyRun:
    """Every episode of a policy.

    Args:
        prepared: the suite.
        policy: the policy.
        executor: runs the episodes.
        margins: measure the robustness margins too.
        advance: told how many episodes, or levels of margins, have ended.
    """
    suite = prepared.suite
    episodes = executor.run(policy.cases, suite.seed_numbers, suite.disturbance, advance)
    return PolicyRun(
        name=policy.name,
        source=policy.checkpoint.source,
        sha256=policy.checkpoint.sha256,
        suite=suite.name,
        case_digests=prepared.digests,
        definitions=dict(DEFINITIONS),
        episodes=tuple(episodes),
        margins=measure_margins(policy.cases, executor, advance) if margins else (),
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
    folder: Path,
    limit: int,
    prepared: PreparedSuite,
    policies: Sequence[TestedPolicy],
    results: Results,
    console: Console,
) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--record-failures: '{folder}' cannot be made a folder: {error.strerror}") from None
    for policy, candidate in zip(policies, results.candidates, strict=True):
        cases = {case.case.name: case for case in policy.cases}
        for episode in choose_failures(candidate.run.episodes, limit):
            path = folder / recording_name(candidate.run.name, episode)
            record_episode(path, cases[episode.case], episode, prepared.suite.disturbance, prepared.robot)
            console.print(f"recorded {path}", markup=False, highlight=False, soft_wrap=True)


def _write(config: RegressConfig, results: Results) -> None:
    """All files that were asked for: what keeps one from being written keeps none of the others.

    Raises:
        InputError: the first that could not be written.
    """
    writers: list[tuple[Path | None, Callable[[Path], None]]] = [
        (config.write_baseline, lambda path: write_json(path, results.candidates[0].run)),
        (config.json, lambda path: write_json(path, results)),
        (config.junit, lambda path: write_junit(path, results)),
        (config.report, lambda path: _write_report(path, results)),
    ]
    problems = []
    for path, write in writers:
        if path is not None:
            try:
                write(path)
            except InputError as error:
                problems.append(error)
    if problems:
        raise problems[0]


def _write_report(path: Path, results: Results) -> None:
    page = report_page(results)
    with whole_file(path) as file:
        file.write(page.encode())
