"""The search: single edits, the best of them at length, then pairs likewise.

Edits of one joint are many, so that each is first tried at a glance; so are pairs. Where no single edit makes a run in
which there is nothing to notice, every two of them are tried: of two mistakes either cure alone may change nothing, or
make it worse, so its rank says nothing, but a second under the right pair differs from all the others.

Every stage has a share of the budget by whose end it stops, a running trial too; what it leaves of the single edits is
tried after the pairs. At the end the best are tried less one part of what they change, so that no right value is
altered along with a wrong one.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.doctor import DoctorConfig
from humanoid_sim.doctor.edits import RobotFacts
from humanoid_sim.doctor.examined_policy import ExaminedPolicy
from humanoid_sim.doctor.hypotheses import Hypothesis, pairs, singles, spared
from humanoid_sim.doctor.ranking import Ranking, Verdict
from humanoid_sim.doctor.trials import Outcome, Trial, TrialRunner

Progress = Callable[[str, int, int], None]
"""Told the stage, and how many of how many changes it has tried; the contract as it is is none."""

_PROMOTED = 16
"""Causes whose best edit is tried at length."""
_CLOSE = 1.2
"""Ratio of costs within which two edits of one cause are both tried at length."""
_RIVALS = 2
_GLANCE = 0.25
"""Share of a brief trial's time for which pairs, and edits of one joint, are tried first."""
_PROBE = 0.125
"""Share of it that shows how fast the machine is."""
_PAST_THE_FALL, _NEARLY_ALL = 1.3, 0.95
"""Times what the robot stays up with nearly all single changes: a cure shows when it does not fall there."""
_PROMOTED_GLANCES = 150
"""Pairs that are tried briefly."""
_PROMOTED_PAIRS = 8
_PROMOTED_DETAILS = 24
"""Edits of one joint that are tried briefly."""
_BRIEFLY, _GLANCED, _PROMOTED_BY, _AT_LENGTH = 0.26, 0.38, 0.43, 0.62
"""Shares of the budget by whose end single edits have been tried briefly, those of one joint at a glance, the best of
these briefly, and the best of all at length."""
_PAIRS_GLANCED, _PAIRS_BRIEFLY, _PAIRS_AT_LENGTH, _REST = 0.77, 0.85, 0.91, 0.95
"""Shares of the budget for pairs, then for single edits that were left over; the end is for parts of the best."""
_SHORTEST = 0.3
"""Share of a trial's time to which it is cut where the machine is slow."""
_LEADERS = 12
"""Causes whose best edits are tried in pairs where one change keeps the robot up already."""
_SPARED = 3
"""Number of the best hypotheses that are tried again without one part of their changes."""
_MOST_PARTS = 6

_COMMANDS = ((0.5, 0.0, 0.0), (0.5, 0.0, 0.5), (-0.5, 0.0, 0.0))
"""Velocities that every walking policy should know, m/s and rad/s."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Trials of each hypothesis, and limits of the search."""

    brief: tuple[Trial, ...]
    thorough: tuple[Trial, ...]
    pairs: int
    """Largest number of pairs to try; 0: none."""
    budget: float | None = None
    """s of wall time in which the search ends; None: when all has been tried."""


def _shortened(trials: tuple[Trial, ...], factor: float) -> tuple[Trial, ...]:
    return tuple(replace(trial, seconds=factor * trial.seconds) for trial in trials)


def make_plan(
    contract: PolicyContract,
    *,
    seconds: float = DoctorConfig.seconds,
    command: tuple[float, float, float] | None = None,
    motion_seconds: float = 0.0,
    pairs: int = DoctorConfig.pairs,
    budget: float | None = None,
) -> Plan:
    """Return the trials for a policy, the brief ones of so many seconds; `pairs` and `budget` are the plan's.

    Without a velocity command there are a few that a walking policy should know; without a motion its length is 0 s.
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
    """Return the nearest command that the policy knows."""
    if contract.command_ranges is None:
        return command
    vx, vy, wz = np.clip(command, contract.command_ranges[:, 0], contract.command_ranges[:, 1])
    return float(vx), float(vy), float(wz)


def search(examined: ExaminedPolicy, robot: RobotFacts, plan: Plan, ranking: Ranking, progress: Progress) -> None:
    """Try the whole space; `ranking` holds what is known whenever this is interrupted."""
    start = time.perf_counter()
    _Search(examined.contract, TrialRunner(examined), robot, plan, ranking, progress, start).run()


@dataclass
class _Search:
    """One search: its stages, and the time that they take."""

    _contract: PolicyContract
    _runner: TrialRunner
    _robot: RobotFacts
    _plan: Plan
    _ranking: Ranking
    _progress: Progress
    _start: float
    _pace: float = 0.0
    """s of wall time for one of simulated time."""

    def run(self) -> None:
        """Go through all stages."""
        contract, ranking = self._contract, self._ranking
        unchanged, changed = Hypothesis((), contract), singles(contract, self._robot)
        details = [hypothesis for hypothesis in changed if hypothesis.is_detail]
        coarse = [unchanged, *(hypothesis for hypothesis in changed if not hypothesis.is_detail)]
        ranking.singles_known = len(changed)
        self._pace = self._measured_pace(unchanged)
        self._plan = replace(self._plan, brief=self._fitting(self._plan.brief, len(coarse), _BRIEFLY))
        rest = self._stage("single changes", coarse, self._plan.brief, ranking, _BRIEFLY)
        glanced = Ranking()
        look = _shortened(self._plan.brief, _long_enough(ranking))
        rest += self._stage("changes of one joint", details, look, glanced, _GLANCED)
        seen = [verdict.hypothesis for verdict in glanced.ordered]
        rest += self._stage("the best of one joint", seen[:_PROMOTED_DETAILS], self._plan.brief, ranking, _PROMOTED_BY)
        ranked = [verdict.hypothesis for verdict in ranking.ordered if verdict.hypothesis.edits]
        ranked += [hypothesis for hypothesis in seen if hypothesis.name not in ranking.verdicts]
        self._at_length(unchanged, _AT_LENGTH)
        self._try_pairs(ranked, look)
        if rest:
            self._stage("single changes left over", rest, self._plan.brief, ranking, _REST)
            self._at_length(unchanged, _REST)
        self._spare()
        ranking.seconds = self._elapsed
        ranking.is_complete = True

    def _measured_pace(self, unchanged: Hypothesis) -> float:
        """Measure the pace in a second trial: in the first the robot is built."""
        probe = _shortened(self._plan.brief, _PROBE)
        self._outcomes(unchanged, probe, math.inf)
        start = self._elapsed
        outcomes = self._outcomes(unchanged, probe, math.inf) or ()
        return (self._elapsed - start) / max(sum(outcome.time_up for outcome in outcomes), 1e-3)

    def _at_length(self, unchanged: Hypothesis, until: float) -> None:
        """Try the best at length that have not been yet."""
        ranking = self._ranking
        promising = [verdict.hypothesis for verdict in ranking.best() if verdict.hypothesis.edits][:_PROMOTED]
        chosen = [unchanged, *_with_rivals(promising, ranking)]
        new = [each for each in chosen if each.name in ranking.verdicts and not ranking.verdicts[each.name].is_thorough]
        if len(new) == len(chosen):
            self._plan = replace(self._plan, thorough=self._fitting(self._plan.thorough, len(new), until))
        self._stage("the best of them", new, self._plan.thorough, ranking, until)

    def _try_pairs(self, ranked: Sequence[Hypothesis], glance: tuple[Trial, ...]) -> None:
        """Try pairs as single changes are; `ranked` are these, best first by their brief trials."""
        plan, ranking, together = self._plan, self._ranking, Ranking()
        known, wanted = _pairs(self._contract, ranked, ranking, plan.pairs)
        ranking.pairs_known = known
        if known > _PROMOTED_GLANCES:
            seen = Ranking()
            left = self._stage("pairs at a glance", wanted, glance, seen, _PAIRS_GLANCED, known)
            best = [verdict.hypothesis for verdict in seen.ordered[:_PROMOTED_GLANCES]]
            self._stage("pairs of changes", best, plan.brief, together, _PAIRS_BRIEFLY)
        else:
            left = self._stage("pairs of changes", wanted, plan.brief, together, _PAIRS_BRIEFLY, known)
        if not left:
            ranking.pairs_known = ranking.pairs_tried  # of some, both together change nothing
        promoted = [verdict.hypothesis for verdict in together.best()[:_PROMOTED_PAIRS]]
        self._stage("the best pairs", promoted, plan.thorough, ranking, _PAIRS_AT_LENGTH)

    def _stage(
        self,
        title: str,
        hypotheses: Iterable[Hypothesis],
        trials: tuple[Trial, ...],
        into: Ranking,
        until: float,
        count: int | None = None,
    ) -> list[Hypothesis]:
        """Try some hypotheses, `count` of them, until that share of the budget is used up.

        Returns those that there was no time for; of an iterator the first.
        """
        # One after the other: most of a trial is Python's, so threads would only wait for each other.
        end = math.inf if self._plan.budget is None else self._start + until * self._plan.budget
        listed = hypotheses if isinstance(hypotheses, Sequence) else ()
        total = sum(bool(hypothesis.edits) for hypothesis in listed) if count is None else count
        done, remaining = 0, iter(hypotheses)
        for hypothesis in remaining:
            outcomes = self._outcomes(hypothesis, trials, end)
            self._ranking.seconds = self._elapsed
            if outcomes is None:
                return [hypothesis, *(remaining if listed else ())]
            into.add(Verdict(hypothesis, outcomes, trials is self._plan.thorough))
            done += bool(hypothesis.edits)
            if trials is not self._plan.thorough:
                self._ranking.tried[hypothesis.name] = len(hypothesis.edits)
            self._progress(title, done, total)
        return []

    def _outcomes(self, hypothesis: Hypothesis, trials: tuple[Trial, ...], end: float) -> tuple[Outcome, ...] | None:
        outcomes = []
        for trial in trials:
            outcome = self._runner.run(hypothesis.contract, trial, end)
            if outcome is None:
                return None
            outcomes.append(outcome)
        return tuple(outcomes)

    @property
    def _elapsed(self) -> float:
        """Wall time so far, s."""
        return time.perf_counter() - self._start

    def _fitting(self, trials: tuple[Trial, ...], count: int, until: float) -> tuple[Trial, ...]:
        """Cut the trials of so many hypotheses such that they end by a share of the budget, if no robot falls."""
        if self._plan.budget is None:
            return trials
        seconds = self._pace * count * sum(trial.seconds for trial in trials)
        factor = (until * self._plan.budget - self._elapsed) / max(seconds, 1e-9)
        return trials if factor >= 1.0 else _shortened(trials, max(factor, _SHORTEST))

    def _spare(self) -> None:
        """Leave out of the best changes what makes nothing better."""
        chosen = [verdict for verdict in self._ranking.best()[:_SPARED] if verdict.stays_up]
        for verdict in chosen:
            smaller = tuple(spared(self._contract, verdict.hypothesis))
            if len(smaller) <= _MOST_PARTS:
                self._stage("parts of the best", smaller, self._plan.thorough, self._ranking, 1.0)


def _long_enough(ranking: Ranking) -> float:
    """Return the share of a brief trial's time in which a change shows what it does, once the coarse ones are tried."""
    if ranking.present is None or ranking.present.stays_up:
        return _GLANCE
    fall = np.quantile([verdict.time_up for verdict in ranking.verdicts.values()], _NEARLY_ALL)
    return float(np.clip(_PAST_THE_FALL * fall, _GLANCE, 1.0))


def _with_rivals(promising: Sequence[Hypothesis], ranking: Ranking) -> list[Hypothesis]:
    """Return the best edit of each cause, and those that a brief trial cannot tell from it."""
    chosen: list[Hypothesis] = []
    for hypothesis in promising:
        best = ranking.verdicts[hypothesis.name]
        rivals = [verdict for verdict in ranking.alternatives(best) if verdict.stays_up == best.stays_up]
        close = [rival.hypothesis for rival in rivals if rival.cost < _CLOSE * best.cost]
        chosen += [hypothesis, *(close[:_RIVALS] if best.stays_up else ())]
    return chosen


def _pairs(
    contract: PolicyContract, ranked: Sequence[Hypothesis], ranking: Ranking, most: int
) -> tuple[int, Iterator[Hypothesis]]:
    """Return the pairs worth trying and at most how many they are, most promising first: none if nothing is wrong.

    Where one change leaves nothing to notice, those of it with every other, and those of the leading causes among
    themselves. Else all, also where one change keeps the robot up: it need not be one of the two mistakes.
    """
    if ranking.is_healthy or ranking.present is None:
        return 0, iter(())
    best = ranking.finding or ranking.best()[0]
    if not best.is_inconspicuous:
        return min(len(ranked) * (len(ranked) - 1) // 2, most), islice(pairs(contract, ranked), most)
    others = [hypothesis for hypothesis in ranked if hypothesis is not best.hypothesis]
    with_best = (pair for other in others for pair in pairs(contract, [best.hypothesis, other]))
    leaders = [verdict.hypothesis for verdict in ranking.best() if len(verdict.hypothesis.edits) == 1]
    among = list(pairs(contract, leaders[1 : _LEADERS + 1]))
    return min(len(others) + len(among), most), islice(chain(with_best, among), most)
