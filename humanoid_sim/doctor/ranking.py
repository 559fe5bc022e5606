"""Results of all hypotheses: which does best, and whether that is a finding."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.doctor.hypotheses import Hypothesis
from humanoid_sim.doctor.trials import Outcome

_WORTH = 0.15
"""Share of the cost that a second change must save: two changes explain anything a little better than one."""
_LONGER = 0.05
"""Difference in the share of the time that the robot stays up, beyond which that alone decides."""
_NOTICED = 1.1
"""A part of the quality from which on an onlooker notices something. A policy that is wired right may tilt by 1.03:
`policy doctor lite_biped_velocity --robot lite_biped --command=0.3,0,0 --pairs 0 --json`."""
_SLIGHT = 0.15
"""Share of the cost below which an improvement may be chance."""
_EQUAL = 0.05
"""Share of the cost by which two runs differ by chance."""
_TELLING = 0.5
"""Cost that a change must save in a run in which there is nothing to notice: published policies that observe no
velocity still walk and dance that way, and a policy that stands well does a little better with smaller actions
(tests/doctor/test_ranking.py)."""
_WORSENED = 0.05
"""Amount by which it must not make any part of such a run worse: with half of its actions a policy that walks well
rocks less, and falls short of its velocity."""


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """Result of one hypothesis."""

    hypothesis: Hypothesis
    outcomes: tuple[Outcome, ...]
    is_thorough: bool
    """True if it was tried at length."""

    @property
    def time_up(self) -> float:
        """Share of the trials' time that the robot stayed up, 0 to 1."""
        return sum(outcome.time_up for outcome in self.outcomes) / sum(outcome.seconds for outcome in self.outcomes)

    @property
    def stays_up(self) -> bool:
        """Return whether it was never lost."""
        return not any(outcome.lost for outcome in self.outcomes)

    @property
    def cost(self) -> float:
        """Mean cost of the trials, smaller is better."""
        return sum(outcome.cost for outcome in self.outcomes) / len(self.outcomes)

    @property
    def is_inconspicuous(self) -> bool:
        """Return whether it was never lost, and an onlooker would have noticed nothing."""
        parts = (part for outcome in self.outcomes for part in outcome.quality.values())
        return self.stays_up and all(part <= _NOTICED for part in parts)

    @property
    def parts(self) -> dict[str, float]:
        """The parts of the cost by name, each the mean over the trials."""
        count = len(self.outcomes)
        names = dict.fromkeys(name for outcome in self.outcomes for name in outcome.quality)
        return {name: sum(outcome.quality.get(name, 0.0) for outcome in self.outcomes) / count for name in names}

    @property
    def worst(self) -> float:
        """The largest part of the cost, or what an onlooker does not notice."""
        return max((_NOTICED, *self.parts.values()))

    def worsens(self, other: Verdict) -> tuple[str, ...]:
        """Return the parts in which it is clearly worse than `other`, of the same trials."""
        before = other.parts
        return tuple(name for name, part in self.parts.items() if part - before.get(name, 0.0) > _WORSENED)

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
    """Results so far; they grow while the search goes on."""

    verdicts: dict[str, Verdict] = field(default_factory=dict)
    """Latest verdict on each hypothesis, by its name."""
    contradicts: Callable[[PolicyContract], bool] | None = None
    """Function that returns True if the trainer's samples, which agree with the present contract, do not agree with
    another; None without samples."""
    is_complete: bool = False
    seconds: float = 0.0
    """s of wall time that the search has taken."""
    tried: dict[str, int] = field(default_factory=dict)
    """Number of edits of each hypothesis that has been tried, be it at a glance, by its name."""
    singles_known: int = 0
    """Single changes in the space."""
    pairs_known: int = 0
    """Pairs that are worth trying; at most so many before all have been tried."""

    @property
    def singles_tried(self) -> int:
        """Number of single changes that have been tried."""
        return list(self.tried.values()).count(1)

    @property
    def pairs_tried(self) -> int:
        """Number of pairs that have been tried."""
        return list(self.tried.values()).count(2)

    @property
    def untried(self) -> str:
        """Say what there was no time for; empty if there was for all."""
        singles = "single changes", self.singles_tried, self.singles_known
        pairs = "pairs of changes", self.pairs_tried, self.pairs_known
        missing = (f"{known - tried} of {known} {what}" for what, tried, known in (singles, pairs) if tried < known)
        return " and ".join(missing)

    def add(self, verdict: Verdict) -> None:
        """Take in a verdict."""
        self.verdicts[verdict.hypothesis.name] = verdict

    @property
    def present(self) -> Verdict | None:
        """Return the verdict on the contract as it is."""
        return next((verdict for verdict in self.verdicts.values() if not verdict.hypothesis.edits), None)

    @property
    def finding(self) -> Verdict | None:
        """The change that cures the contract, as far as is known; None: none does, or there is nothing to cure.

        Where the contract as it is lets nobody notice anything, a change that is only a little better, or better in one
        part of the quality and worse in another, is none: some change suits every healthy policy. Where it stays up at
        all, a change that the trainer's samples contradict is none either.
        """
        present = self.present
        for verdict in self.best():
            if not verdict.hypothesis.edits and verdict.stays_up:
                return None  # no other does better
            if verdict.stays_up and (present is None or self._cures(verdict, present)):
                return verdict
        return None

    @property
    def ruled_out(self) -> Verdict | None:
        """The best change before the contract as it is that the trainer's samples contradict; None: there is none."""
        for verdict in self.best():
            if not verdict.hypothesis.edits:
                return None
            if verdict.stays_up and self._is_contradicted(verdict):
                return verdict
        return None

    def _is_contradicted(self, verdict: Verdict) -> bool:
        return self.contradicts is not None and self.contradicts(verdict.hypothesis.contract)

    def _cures(self, verdict: Verdict, present: Verdict) -> bool:
        if present.stays_up and self._is_contradicted(verdict):
            return False
        if not present.is_inconspicuous:
            return True
        return present.cost - verdict.cost >= _TELLING and not verdict.worsens(present)

    @property
    def is_healthy(self) -> bool:
        """Return whether the contract as it is keeps the robot up, and no change cures it of anything."""
        return self.present is not None and self.present.stays_up and self.finding is None

    def saved(self, verdict: Verdict) -> float:
        """Get the share of the present cost that a change saves; below a cost of 1 nobody would notice a difference."""
        return 0.0 if self.present is None else (self.present.cost - verdict.cost) / max(self.present.cost, 1.0)

    def is_slight(self, verdict: Verdict) -> bool:
        """Return whether what a change saves may be chance."""
        return self.saved(verdict) < _SLIGHT

    @property
    def ordered(self) -> list[Verdict]:
        """All verdicts, best first."""
        return sorted(self.verdicts.values(), key=lambda verdict: verdict.order)

    def best(self) -> list[Verdict]:
        """Best first: of every cause its best edit, and of pairs those that do better than each of their halves."""
        found: dict[tuple[str, ...], Verdict] = {}
        for verdict in self.ordered:
            if len(verdict.hypothesis.edits) < 2 or self._pays(verdict):
                found.setdefault(verdict.hypothesis.causes, verdict)
        return list(found.values())

    def _pays(self, pair: Verdict) -> bool:
        """Tell whether two changes are worth it: standing still pays off in all other parts, and is not walking."""
        up = (v for v in self.verdicts.values() if len(v.hypothesis.edits) < 2 and v.is_thorough and v.stays_up)
        if pair.worst > min((single.worst for single in up), default=math.inf) + _WORSENED:
            return False
        halves = [self.verdicts[edit.name] for edit in pair.hypothesis.edits if edit.name in self.verdicts]
        return all(
            pair.time_up > half.time_up
            if abs(pair.time_up - half.time_up) > _LONGER
            else pair.doubtful_cost < (1.0 - _WORTH) * half.doubtful_cost
            for half in halves
        )

    def equals(self, verdict: Verdict) -> list[Verdict]:
        """Return changes of other causes, no more at once, that do as well: these trials cannot tell which is right."""
        limit = verdict.cost + _EQUAL * max(verdict.cost, 1.0)
        return [
            other
            for other in self.best()
            if other.hypothesis.causes != verdict.hypothesis.causes
            and 0 < len(other.hypothesis.edits) <= len(verdict.hypothesis.edits)
            and other.is_thorough
            and other.stays_up
            and other.cost <= limit
        ]

    def alternatives(self, verdict: Verdict) -> list[Verdict]:
        """Other edits of the same cause, best first."""
        causes = verdict.hypothesis.causes
        return [other for other in self.ordered if other.hypothesis.causes == causes and other is not verdict]
