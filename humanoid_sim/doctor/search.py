"""The search: every single edit briefly, the best of them at length, then pairs of the promising ones likewise."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.doctor.edits import RobotFacts
from humanoid_sim.doctor.examined_policy import ExaminedPolicy
from humanoid_sim.doctor.hypotheses import Hypothesis, pairs, present, singles
from humanoid_sim.doctor.trials import Outcome, Trial, TrialRunner

__all__ = ["Plan", "Progress", "Ranking", "Verdict", "make_plan", "search"]

Progress = Callable[[str, int, int], None]
"""Told the stage, and how many of how many hypotheses it has tried."""

_PROMOTED = 16
"""Causes whose best edit is tried at length."""
_CLOSE = 1.2
"""Ratio of costs within which two edits of one cause are both tried at length."""
_RIVALS = 2
_WORTH = 0.15
"""Share of the cost that a second change must save: two changes explain anything a little better than one."""
_LONGER = 0.05
"""Share of the time that it must keep the robot up for longer instead, and not less."""
_PAIRS = 1200
_PROMOTED_PAIRS = 8

_COMMANDS = ((0.5, 0.0, 0.0), (0.5, 0.0, 0.5), (-0.5, 0.0, 0.0))
"""Velocities that every walking policy should know, m/s and rad/s."""


@dataclass(frozen=True, slots=True)
class Plan:
    """How each hypothesis is tried."""

    brief: tuple[Trial, ...]
    thorough: tuple[Trial, ...]
    pairs: int
    """At most so many pairs are tried; 0: none."""


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """What became of one hypothesis."""

    hypothesis: Hypothesis
    outcomes: tuple[Outcome, ...]
    is_thorough: bool
    """Whether it was tried at length."""

    @property
    def time_up(self) -> float:
        """Share of the trials' time that the robot stayed up, 0 to 1."""
        return sum(outcome.time_up for outcome in self.outcomes) / sum(outcome.seconds for outcome in self.outcomes)

    @property
    def stays_up(self) -> bool:
        """Whether it was never lost."""
        return not any(outcome.lost for outcome in self.outcomes)

    @property
    def cost(self) -> float:
        """Mean cost of the trials, smaller is better."""
        return sum(outcome.quality.cost for outcome in self.outcomes) / len(self.outcomes)

    @property
    def doubtful_cost(self) -> float:
        """The cost, and what the hypothesis must save to be believed: below 1 nobody would notice a difference."""
        return self.cost + self.hypothesis.doubt * max(self.cost, 1.0)

    @property
    def order(self) -> tuple[float, ...]:
        """Sorts verdicts, best first: at length before briefly, then the time up, then the cost."""
        return (-float(self.is_thorough), -round(self.time_up, 2), self.doubtful_cost)


@dataclass
class Ranking:
    """What is known so far; it grows while the search goes on."""

    verdicts: dict[str, Verdict] = field(default_factory=dict)
    """By the hypothesis's name, the latest of each."""
    is_complete: bool = False

    def add(self, verdict: Verdict) -> None:
        """Take in a verdict."""
        self.verdicts[verdict.hypothesis.name] = verdict

    @property
    def present(self) -> Verdict | None:
        """Of the contract as it is."""
        return next((verdict for verdict in self.verdicts.values() if not verdict.hypothesis.edits), None)

    def best(self) -> list[Verdict]:
        """Best first: of every cause its best edit, and of pairs those that do better than each of their halves."""
        found: dict[tuple[str, ...], Verdict] = {}
        for verdict in sorted(self.verdicts.values(), key=lambda verdict: verdict.order):
            if len(verdict.hypothesis.edits) < 2 or self._pays(verdict):
                found.setdefault(verdict.hypothesis.causes, verdict)
        return list(found.values())

    def _pays(self, pair: Verdict) -> bool:
        halves = [self.verdicts[edit.name] for edit in pair.hypothesis.edits if edit.name in self.verdicts]
        return all(_beats(pair, half) for half in halves)

    def alternatives(self, verdict: Verdict) -> list[Verdict]:
        """Other edits of the same cause, best first."""
        same = [v for v in self.verdicts.values() if v.hypothesis.causes == verdict.hypothesis.causes]
        return sorted((v for v in same if v is not verdict), key=lambda v: v.order)


def _beats(pair: Verdict, half: Verdict) -> bool:
    """Whether a second change is worth it."""
    if abs(pair.time_up - half.time_up) > _LONGER:
        return pair.time_up > half.time_up
    return pair.doubtful_cost < (1.0 - _WORTH) * half.doubtful_cost


def make_plan(
    contract: PolicyContract,
    *,
    seconds: float = 4.0,
    command: tuple[float, float, float] | None = None,
    motion_seconds: float = 0.0,
    pairs: int = _PAIRS,
) -> Plan:
    """The trials for a policy.

    Args:
        contract: of the policy.
        seconds: of a brief trial.
        command: velocity for all trials; None for a few that a walking policy should know.
        motion_seconds: length of the motion; 0 for none.
        pairs: at most so many are tried.
    """
    if contract.task_type != "locomotion":
        long = max(min(motion_seconds, 5.0 * seconds), contract.policy_dt)
        return Plan((Trial(min(seconds, long)),), (Trial(long), Trial(long, yaw=-1.0)), pairs)
    commands = [command] if command else [_within(wanted, contract) for wanted in _COMMANDS]
    headings = (2.0, -1.0, 2.5)
    brief = Trial(seconds, commands[0], headings[0])
    thorough = [Trial(1.5 * seconds, commands[i % len(commands)], heading) for i, heading in enumerate(headings)]
    return Plan((brief,), tuple(thorough), pairs)


def _within(command: tuple[float, float, float], contract: PolicyContract) -> tuple[float, float, float]:
    """The nearest command that the policy knows."""
    if contract.command_ranges is None:
        return command
    vx, vy, wz = np.clip(command, contract.command_ranges[:, 0], contract.command_ranges[:, 1])
    return float(vx), float(vy), float(wz)


def search(examined: ExaminedPolicy, robot: RobotFacts, plan: Plan, ranking: Ranking, progress: Progress) -> None:
    """Try the whole space; `ranking` holds what is known whenever this is interrupted."""
    contract = examined.contract
    runner = TrialRunner(examined)

    def stage(
        title: str, hypotheses: Sequence[Hypothesis], trials: tuple[Trial, ...], is_thorough: bool, into: Ranking
    ) -> None:
        # One after the other: most of a trial is Python's, so threads would only wait for each other.
        for done, hypothesis in enumerate(hypotheses, 1):
            outcomes = tuple(runner.run(hypothesis.contract, trial) for trial in trials)
            into.add(Verdict(hypothesis, outcomes, is_thorough))
            progress(title, done, len(hypotheses))

    unchanged, changed = present(contract), singles(contract, robot)
    stage("single changes", [unchanged, *changed], plan.brief, False, ranking)
    promising = [verdict.hypothesis for verdict in ranking.best() if verdict.hypothesis.edits]
    chosen = [unchanged, *_with_rivals(promising[:_PROMOTED], ranking)]
    stage("the best of them", chosen, plan.thorough, True, ranking)
    together = Ranking()
    stage("pairs of changes", _pairs(contract, changed, ranking, plan.pairs), plan.brief, False, together)
    best = [verdict.hypothesis for verdict in together.best()[:_PROMOTED_PAIRS]]
    stage("the best pairs", best, plan.thorough, True, ranking)
    ranking.is_complete = True


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
    """The pairs worth trying: none if nothing is wrong; those with the best if it keeps the robot up, else all."""
    best = ranking.best()[0]
    if best.stays_up and not best.hypothesis.edits:
        return []
    ranked = sorted(everything, key=lambda hypothesis: ranking.verdicts[hypothesis.name].order)
    found: Iterable[Hypothesis]
    if best.stays_up:
        others = (hypothesis for hypothesis in ranked if hypothesis is not best.hypothesis)
        found = (pair for other in others for pair in pairs(contract, [best.hypothesis, other]))
    else:
        found = pairs(contract, ranked)
    return [pair for _, pair in zip(range(count), found, strict=False)]
