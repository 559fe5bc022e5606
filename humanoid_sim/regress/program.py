"""`regress`: read, run, compare, say so, write it down."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from msgspec.structs import replace
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from humanoid_sim.errors import InputError
from humanoid_sim.files import whole_file
from humanoid_sim.regress.arena import Arena
from humanoid_sim.regress.baseline_file import read_baseline, write_json
from humanoid_sim.regress.cluster import LOCAL, RayExecutor
from humanoid_sim.regress.compare import detectable_changes
from humanoid_sim.regress.config import RegressConfig
from humanoid_sim.regress.jobs import Executor, LocalExecutor
from humanoid_sim.regress.junit import write_junit
from humanoid_sim.regress.options import check_outputs, chosen_suite
from humanoid_sim.regress.recordings import choose_failures, record_episode, recording_name
from humanoid_sim.regress.report import report_page
from humanoid_sim.regress.results import PolicyRun, Results
from humanoid_sim.regress.runner import (
    Contest,
    judge,
    matching_baseline,
    prepare_contest,
    run_policy,
    suite_info,
)
from humanoid_sim.regress.show import show_candidate, show_detectable, show_run, show_verdict
from humanoid_sim.regress.subject import Subject, load_subject, robot_name, suite_robot, unique_names
from humanoid_sim.regress.suite_file import load_suite

__all__ = ["regress"]


@dataclass(frozen=True, slots=True, eq=False)
class _Entrant:
    """A policy that is to be run, with what it needs for each case."""

    subject: Subject
    arenas: list[Arena]


@dataclass(frozen=True, slots=True, eq=False)
class _Plan:
    """Everything that was named, read and found to fit: from here on nothing is refused."""

    contest: Contest
    baseline: _Entrant | PolicyRun | None
    candidates: list[_Entrant]
    robot: str
    """Its name or path."""


def regress(config: RegressConfig) -> int:
    """Run policies over a suite; the exit status is 1 if one is worse than the baseline.

    Raises:
        InputError: if what was given cannot be used.
    """
    check_outputs(config)
    plan = _plan(config)
    console = Console(quiet=config.quiet, emoji=False)  # a name such as ':a:' is no picture
    executor = _executor(config)
    try:
        results = _run(config, plan, executor, console)
    finally:
        executor.close()
    plain = Console(emoji=False)
    for candidate in results.candidates:
        show_verdict(plain, results, candidate)
    _write(config, results)
    if config.record_failures is not None:
        _record(config.record_failures, config.record_limit, plan, results, console)
    return 0 if results.passed else 1


def _plan(config: RegressConfig) -> _Plan:
    suite, folder = load_suite(config.suite)
    suite = chosen_suite(config, suite)
    description = suite_robot(suite, folder, config.robot)
    contest = prepare_contest(suite, folder, description)
    contract = None if config.contract is None else Path(config.contract)
    subjects = [load_subject(Path(policy), contract, description, suite) for policy in config.policies]
    candidates = [_Entrant(subject, contest.arenas(subject)) for subject in unique_names(subjects)]
    robot = robot_name(suite, folder, config.robot)
    return _Plan(contest, _baseline(config, contest, contract), candidates, robot)


def _baseline(config: RegressConfig, contest: Contest, contract: Path | None) -> _Entrant | PolicyRun | None:
    if config.baseline is None:
        return None
    path = Path(config.baseline)
    if path.suffix == ".onnx":
        subject = load_subject(path, contract, contest.description, contest.suite)
        return _Entrant(subject, contest.arenas(subject))
    return matching_baseline(contest, read_baseline(path), config.baseline)


def _executor(config: RegressConfig) -> Executor:
    if config.ray is None:
        return LocalExecutor(config.threads)
    return RayExecutor(config.ray, config.threads if config.ray == LOCAL else None)


def _run(config: RegressConfig, plan: _Plan, executor: Executor, console: Console) -> Results:
    """The baseline first, then what it can tell apart, then the candidates."""
    contest, suite = plan.contest, plan.contest.suite
    baseline = plan.baseline
    if isinstance(baseline, _Entrant):
        baseline = _run_one(config, contest, baseline, executor, "baseline")
    results = Results(
        suite=suite_info(contest, plan.candidates[0].arenas),
        metrics=suite.metrics,
        confidence=suite.confidence,
        resamples=suite.resamples,
        baseline=baseline,
        detectable=() if baseline is None else detectable_changes(suite, suite.metrics, baseline),
        candidates=(),
    )
    show_detectable(console, results)
    for entrant in plan.candidates:
        candidate = judge(contest, baseline, _run_one(config, contest, entrant, executor, entrant.subject.name))
        results = replace(results, candidates=(*results.candidates, candidate))
        if baseline is None:
            show_run(console, results, candidate.run)
        else:
            show_candidate(console, results, candidate)
    return results


def _run_one(config: RegressConfig, contest: Contest, entrant: _Entrant, executor: Executor, label: str) -> PolicyRun:
    suite = contest.suite
    levels = sum(len(sweep.levels) for sweep in suite.margins.sweeps) if config.margins and suite.margins else 0
    with _progress(label, len(suite.cases) * suite.seeds + levels, config.quiet) as advance:
        return run_policy(
            contest, entrant.subject, entrant.arenas, executor, margins=config.margins, progress=advance.by
        )


class _Advance:
    """Moves a bar on."""

    def __init__(self, bar: Progress, label: str, total: int) -> None:
        self._bar = bar
        self._task = bar.add_task(label, total=total)

    def by(self, count: int) -> None:
        """Some more are done."""
        self._bar.advance(self._task, count)


@contextmanager
def _progress(label: str, total: int, quiet: bool) -> Iterator[_Advance]:
    """A bar on stderr, if a person is watching."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=quiet or not console.is_terminal) as bar:
        yield _Advance(bar, label, total)


def _record(folder: Path, limit: int, plan: _Plan, results: Results, console: Console) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--record-failures: '{folder}' cannot be made a folder: {error.strerror}") from None
    for entrant, candidate in zip(plan.candidates, results.candidates, strict=True):
        arenas = {arena.case.name: arena for arena in entrant.arenas}
        for episode in choose_failures(candidate.run.episodes, limit):
            path = folder / recording_name(candidate.run.name, episode)
            arena, disturbance = arenas[episode.case], plan.contest.disturbance
            record_episode(path, plan.contest.suite, arena, episode, disturbance, plan.robot)
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
