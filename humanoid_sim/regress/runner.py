"""Policies over a suite: every episode run, everything compared."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import msgspec
import mujoco
import numpy as np

from humanoid_sim import __version__
from humanoid_sim.errors import InputError, known_names
from humanoid_sim.policy.motion import Motion
from humanoid_sim.regress.arena import Arena, case_motion, make_arena
from humanoid_sim.regress.compare import compare_runs
from humanoid_sim.regress.digests import case_digest
from humanoid_sim.regress.episodes import Disturbance
from humanoid_sim.regress.jobs import Executor, Job, Progress
from humanoid_sim.regress.margins import compare_margins, measure_margins
from humanoid_sim.regress.results import Candidate, PolicyRun, SuiteInfo
from humanoid_sim.regress.subject import Subject
from humanoid_sim.regress.suite import Suite
from humanoid_sim.robots.schema import RobotDescription

__all__ = ["Contest", "judge", "matching_baseline", "prepare_contest", "run_policy", "suite_info"]


@dataclass(frozen=True, slots=True, eq=False)
class Contest:
    """A suite with its motions read, on a robot."""

    suite: Suite
    description: RobotDescription
    motions: Mapping[str, Motion | None]
    """By case; None where the case names none."""
    digests: Mapping[str, str]
    """By case."""

    @property
    def disturbance(self) -> Disturbance:
        """Of the suite's episodes."""
        return Disturbance(self.suite.draw(), self.suite.pushes)

    def arenas(self, subject: Subject) -> list[Arena]:
        """One per case.

        Raises:
            InputError: the policy does not fit one.
        """
        return [make_arena(self.suite, subject, case, self.motions[case.name]) for case in self.suite.cases]


def prepare_contest(suite: Suite, folder: Path, description: RobotDescription) -> Contest:
    """Read what the suite names; `folder` is what its paths are relative to.

    Raises:
        InputError: a motion cannot be read.
    """
    motions = {case.name: case_motion(folder, case) for case in suite.cases}
    digests = {case.name: case_digest(suite, case, motions[case.name], description) for case in suite.cases}
    return Contest(suite, description, motions, digests)


def run_policy(
    contest: Contest,
    subject: Subject,
    arenas: Sequence[Arena],
    executor: Executor,
    *,
    margins: bool = False,
    progress: Progress = lambda _: None,
) -> PolicyRun:
    """Every episode of a policy.

    Args:
        contest: the suite.
        subject: the policy.
        arenas: of it.
        executor: runs the episodes.
        margins: measure the robustness margins too.
        progress: told how many episodes, or levels of margins, have ended.
    """
    suite = contest.suite
    jobs = [Job(arena, suite.seed_numbers, contest.disturbance) for arena in arenas]
    episodes = [episode for batch in executor.run(suite, jobs, progress) for episode in batch]
    return PolicyRun(
        name=subject.name,
        source=subject.checkpoint.source,
        sha256=subject.checkpoint.sha256,
        suite=suite.name,
        case_digests=contest.digests,
        episodes=tuple(episodes),
        margins=measure_margins(suite, arenas, executor, progress) if margins else (),
        batching=subject.policy.batching,
        versions=_versions(),
    )


def matching_baseline(contest: Contest, baseline: PolicyRun, source: str) -> PolicyRun:
    """The part of a stored baseline that the suite's cases are compared with.

    Raises:
        InputError: a case is not in it, or was another when the baseline was made.
    """
    for name, digest in contest.digests.items():
        if name not in baseline.case_digests:
            raise InputError(f"{source}: {known_names('case', name, baseline.case_digests)}")
        if baseline.case_digests[name] != digest:
            raise InputError(
                f"{source}: its case '{name}' was run under other conditions (suite, motion or robot have changed "
                "since); make a new baseline with --write-baseline"
            )
    kept = tuple(episode for episode in baseline.episodes if episode.case in contest.digests)
    return msgspec.structs.replace(baseline, episodes=kept, case_digests=contest.digests)


def judge(contest: Contest, baseline: PolicyRun | None, run: PolicyRun) -> Candidate:
    """The verdicts on a run."""
    if baseline is None:
        return Candidate(run=run, passed=True)
    comparisons = compare_runs(contest.suite, contest.suite.metrics, baseline, run)
    margins = compare_margins(contest.suite, baseline.margins, run.margins)
    is_worse = any(comparison.verdict == "worse" or comparison.is_lost for comparison in comparisons)
    passed = not is_worse and all(margin.verdict != "worse" for margin in margins)
    return Candidate(run=run, passed=passed, comparisons=comparisons, margins=margins)


def suite_info(contest: Contest, arenas: Sequence[Arena]) -> SuiteInfo:
    """What a report says about the suite."""
    suite = contest.suite
    return SuiteInfo(
        name=suite.name,
        summary=suite.summary,
        task=suite.task,
        robot=contest.description.name,
        cases=tuple(case.name for case in suite.cases),
        seeds=suite.seed_numbers,
        duration=max(arena.steps * arena.policy_dt for arena in arenas),
        policy_dt=min(arena.policy_dt for arena in arenas),
    )


def _versions() -> dict[str, str]:
    return {
        "humanoid_sim": __version__,
        "mujoco": mujoco.__version__,
        "numpy": np.__version__,
        "onnxruntime": version("onnxruntime"),
        "python": platform.python_version(),
        "platform": platform.platform(),
    }
