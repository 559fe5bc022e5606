"""The search: every single edit briefly, the best of them at length, then pairs likewise.

Where no single edit makes a run in which there is nothing to notice, every two of them are tried, at a glance: of two
mistakes either cure alone may change nothing, or make it worse, so its rank says nothing, but half a second under the
right pair differs from all the others. The best of those are then tried briefly.

At the end the best are tried less one part of what they change, so that no right value is altered along with a wrong
one.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.doctor.edits import RobotFacts
from humanoid_sim.doctor.examined_policy import ExaminedPolicy
from humanoid_sim.doctor.hypotheses import Hypothesis, pairs, present, singles, spared
from humanoid_sim.doctor.ranking import Ranking, Verdict
from humanoid_sim.doctor.trials import Outcome, Trial, TrialRunner

__all__ = ["Plan", "Progress", "make_plan", "search"]

Progress = Callable[[str, int, int], None]
"""Told the stage, and how many of how many changes it has tried; the contract as it is is none."""

_PROMOTED = 16
"""Causes whose best edit is tried at length."""
_CLOSE = 1.2
"""Ratio of costs within which two edits of one cause are both tried at length."""
_RIVALS = 2
_PAIRS = 6000
"""More than any contract has."""
_GLANCE = 0.125
"""Share of a brief trial's time."""
_PROMOTED_GLANCES = 150
"""Pairs that are tried briefly."""
_PROMOTED_PAIRS = 8
_GLANCED_BY, _TRIED_BY = 0.6, 0.85
"""Shares of the budget after which pairs are no longer looked at, and no longer tried briefly."""
_LEADERS = 12
"""Causes whose best edits are tried in pairs where one change keeps the robot up already."""
_SPARED = 3
"""Of the best, those that are tried less one part of what they change."""
_MOST_PARTS = 6
_LONGEST_FALL = 0.5
"""Share of a brief trial's time that is counted for one that ends in a fall."""

_COMMANDS = ((0.5, 0.0, 0.0), (0.5, 0.0, 0.5), (-0.5, 0.0, 0.0))
"""Velocities that every walking policy should know, m/s and rad/s."""


@dataclass(frozen=True, slots=True)
class Plan:
    """How each hypothesis is tried."""

    brief: tuple[Trial, ...]
    thorough: tuple[Trial, ...]
    pairs: int
    """At most so many pairs are tried; 0: none."""
    budget: float | None = None
    """s of wall time: pairs are tried until so much is used up; None: until they have all been tried."""

    @property
    def glance(self) -> tuple[Trial, ...]:
        """Of pairs, where there are many."""
        return tuple(replace(trial, seconds=_GLANCE * trial.seconds) for trial in self.brief)


def make_plan(
    contract: PolicyContract,
    *,
    seconds: float = 4.0,
    command: tuple[float, float, float] | None = None,
    motion_seconds: float = 0.0,
    pairs: int = _PAIRS,
    budget: float | None = None,
) -> Plan:
    """The trials for a policy.

    Args:
        contract: of the policy.
        seconds: of a brief trial.
        command: velocity for all trials; None for a few that a walking policy should know.
        motion_seconds: length of the motion; 0 for none.
        pairs: at most so many are tried.
        budget: s of wall time, as `Plan.budget`.
    """
    if contract.task_type != "locomotion":
        long = max(min(motion_seconds, 5.0 * seconds), contract.policy_dt)
        return Plan((Trial(min(seconds, long)),), (Trial(long), Trial(long, yaw=-1.0)), pairs, budget)
    commands = [command] if command else [_within(wanted, contract) for wanted in _COMMANDS]
    headings = (2.0, -1.0, 2.5)
    brief = Trial(seconds, commands[0], headings[0])
    thorough = [Trial(1.5 * seconds, commands[i % len(commands)], heading) for i, heading in enumerate(headings)]
    return Plan((brief,), tuple(thorough), pairs, budget)


def _within(command: tuple[float, float, float], contract: PolicyContract) -> tuple[float, float, float]:
    """The nearest command that the policy knows."""
    if contract.command_ranges is None:
        return command
    vx, vy, wz = np.clip(command, contract.command_ranges[:, 0], contract.command_ranges[:, 1])
    return float(vx), float(vy), float(wz)


def search(examined: ExaminedPolicy, robot: RobotFacts, plan: Plan, ranking: Ranking, progress: Progress) -> None:
    """Try the whole space; `ranking` holds what is known whenever this is interrupted."""
    _Search(examined, robot, plan, ranking, progress).run()


class _Search:
    """One search: its stages, and the time that they take."""

    def __init__(
        self, examined: ExaminedPolicy, robot: RobotFacts, plan: Plan, ranking: Ranking, progress: Progress
    ) -> None:
        self._contract = examined.contract
        self._robot = robot
        self._plan = plan
        self._ranking = ranking
        self._progress = progress
        self._runner = TrialRunner(examined)
        self._start = time.perf_counter()
        self._simulated = 0.0
        """s of simulated time so far."""

    def run(self) -> None:
        """All stages."""
        contract, plan, ranking = self._contract, self._plan, self._ranking
        unchanged, changed = present(contract), singles(contract, self._robot)
        self._expect(unchanged, len(changed))
        self._stage("single changes", [unchanged, *changed], plan.brief, ranking)
        promising = [verdict.hypothesis for verdict in ranking.best() if verdict.hypothesis.edits]
        chosen = [unchanged, *_with_rivals(promising[:_PROMOTED], ranking)]
        self._stage("the best of them", chosen, plan.thorough, ranking)
        ranking.single_seconds = ranking.seconds
        wanted, together = _pairs(contract, changed, ranking, plan.pairs), Ranking()
        ranking.pairs_known = len(wanted)
        if len(wanted) > _PROMOTED_GLANCES:
            seen = Ranking()
            self._stage("pairs at a glance", wanted, plan.glance, seen, until=_GLANCED_BY)
            ranking.pairs_tried = len(seen.verdicts)
            glanced = sorted(seen.verdicts.values(), key=lambda verdict: verdict.order)
            wanted = [verdict.hypothesis for verdict in glanced[:_PROMOTED_GLANCES]]
        self._stage("pairs of changes", wanted, plan.brief, together, until=_TRIED_BY)
        ranking.pairs_tried = max(ranking.pairs_tried, len(together.verdicts))
        best = [verdict.hypothesis for verdict in together.best()[:_PROMOTED_PAIRS]]
        self._stage("the best pairs", best, plan.thorough, ranking)
        self._spare()
        ranking.is_complete = True

    def _stage(
        self,
        title: str,
        hypotheses: Sequence[Hypothesis],
        trials: tuple[Trial, ...],
        into: Ranking,
        *,
        until: float | None = None,
    ) -> None:
        """Try some hypotheses; with `until` only while no more than that share of the budget is used up."""
        # One after the other: most of a trial is Python's, so threads would only wait for each other.
        done, total = 0, sum(bool(hypothesis.edits) for hypothesis in hypotheses)
        for hypothesis in hypotheses:
            if until is not None and self._plan.budget is not None and self._elapsed > until * self._plan.budget:
                return
            into.add(Verdict(hypothesis, self._outcomes(hypothesis, trials), trials is self._plan.thorough))
            self._ranking.seconds = self._elapsed
            done += bool(hypothesis.edits)
            self._progress(title, done, total)

    def _outcomes(self, hypothesis: Hypothesis, trials: tuple[Trial, ...]) -> tuple[Outcome, ...]:
        outcomes = tuple(self._runner.run(hypothesis.contract, trial) for trial in trials)
        self._simulated += sum(outcome.time_up for outcome in outcomes)
        return outcomes

    @property
    def _elapsed(self) -> float:
        """Wall time so far, s."""
        return time.perf_counter() - self._start

    def _expect(self, unchanged: Hypothesis, count: int) -> None:
        """Work out from the first trial how long single changes take: the robot is built by then, so run it again."""
        self._outcomes(unchanged, self._plan.brief)
        start, simulated = self._elapsed, self._simulated
        outcomes = self._outcomes(unchanged, self._plan.brief)
        pace = (self._elapsed - start) / max(self._simulated - simulated, 1e-3)
        share = 1.0 if not any(outcome.lost for outcome in outcomes) else _LONGEST_FALL
        briefly = (count + 1) * share * sum(trial.seconds for trial in self._plan.brief)
        at_length = (_PROMOTED + 1) * share * sum(trial.seconds for trial in self._plan.thorough)
        self._ranking.expected = self._elapsed + pace * (briefly + at_length)

    def _spare(self) -> None:
        """Leave out of the best changes what makes nothing better."""
        chosen = [verdict for verdict in self._ranking.best()[:_SPARED] if verdict.stays_up]
        for verdict in chosen:
            smaller = tuple(spared(self._contract, verdict.hypothesis))
            if len(smaller) <= _MOST_PARTS:
                self._stage("parts of the best", smaller, self._plan.thorough, self._ranking)


def _with_rivals(promising: Sequence[Hypothesis], ranking: Ranking) -> list[Hypothesis]:
    """The best edit of each cause, and those that a brief trial cannot tell from it."""
    chosen: list[Hypothesis] = []
    for hypothesis in promising:
        best = ranking.verdicts[hypothesis.name]
        rivals = [verdict for verdict in ranking.alternatives(best) if verdict.stays_up == best.stays_up]
        close = [rival.hypothesis for rival in rivals if rival.cost < _CLOSE * best.cost]
        chosen += [hypothesis, *(close[:_RIVALS] if best.stays_up else ())]
    return chosen


def _pairs(
    contract: PolicyContract, everything: Sequence[Hypothesis], ranking: Ranking, count: int
) -> list[Hypothesis]:
    """The pairs worth trying, most promising first: none if nothing is wrong.

    Where one change leaves nothing to notice, those of it with every other, and those of the leading causes among
    themselves. Else all, also where one change keeps the robot up: it need not be one of the two mistakes.
    """
    if ranking.is_healthy:
        return []
    best = ranking.finding or ranking.best()[0]
    ranked = sorted(everything, key=lambda hypothesis: ranking.verdicts[hypothesis.name].order)
    found: Iterable[Hypothesis]
    if best.is_inconspicuous:
        others = (hypothesis for hypothesis in ranked if hypothesis is not best.hypothesis)
        with_best = (pair for other in others for pair in pairs(contract, [best.hypothesis, other]))
        leaders = [verdict.hypothesis for verdict in ranking.best() if len(verdict.hypothesis.edits) == 1]
        found = chain(with_best, pairs(contract, leaders[1 : _LEADERS + 1]))
    else:
        found = pairs(contract, ranked)
    return list(islice(found, count))
