"""Results of all hypotheses: which does best, and whether that is a finding."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.doctor.hypotheses import Hypothesis
from humanoid_sim.doctor.trials import Outcome

_NOTICED = 1.1
"""A part of the quality from which on an onlooker notices something. A policy that is wired right may tilt by 1.03:
`policy doctor lite_biped_velocity --robot lite_biped --command=0.3,0,0 --json`."""
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
    outcome: Outcome

    @property
    def time_up(self) -> float:
        """Share of the trial's time that the robot stayed up, 0 to 1."""
        return self.outcome.time_up / self.outcome.seconds

    @property
    def stays_up(self) -> bool:
        """Return whether it was never lost."""
        return not self.outcome.lost

    @property
    def cost(self) -> float:
        """Cost of the trial, smaller is better."""
        return self.outcome.cost

    @property
    def is_inconspicuous(self) -> bool:
        """Return whether it was never lost, and an onlooker would have noticed nothing."""
        return self.stays_up and all(part <= _NOTICED for part in self.outcome.quality.values())

    def worsens(self, other: Verdict) -> tuple[str, ...]:
        """Return the parts of the quality in which it is clearly worse than `other`."""
        before, after = other.outcome.quality, self.outcome.quality
        return tuple(name for name, part in after.items() if part - before.get(name, 0.0) > _WORSENED)

    @property
    def doubtful_cost(self) -> float:
        """The cost, and what the hypothesis must save to be believed: below 1 nobody would notice a difference."""
        return self.cost + self.hypothesis.doubt * max(self.cost, 1.0)

    @property
    def order(self) -> tuple[float, float]:
        """Sorts verdicts, best first: by the time up, then by the cost."""
        return -round(self.time_up, 2), self.doubtful_cost


@dataclass
class Ranking:
    """Results so far; they grow while the search goes on."""

    verdicts: dict[str, Verdict] = field(default_factory=dict)
    """Verdict on each hypothesis, by its name."""
    contradicts: Callable[[PolicyContract], bool] | None = None
    """Function that returns True if the trainer's samples, which agree with the present contract, do not agree with
    another; None without samples."""
    known: int = 0
    """Changes in the space."""
    seconds: float = 0.0
    """s of wall time that the search has taken."""

    @property
    def tried(self) -> int:
        """Number of changes that have been tried."""
        return len(self.verdicts) - (self.present is not None)

    def add(self, verdict: Verdict) -> None:
        """Take in a verdict."""
        self.verdicts[verdict.hypothesis.name] = verdict

    @property
    def present(self) -> Verdict | None:
        """Return the verdict on the contract as it is."""
        return next((verdict for verdict in self.verdicts.values() if verdict.hypothesis.edit is None), None)

    @property
    def finding(self) -> Verdict | None:
        """The change that cures the contract, as far as is known; None: none does, or there is nothing to cure.

        Where the contract as it is lets nobody notice anything, a change that is only a little better, or better in one
        part of the quality and worse in another, is none: some change suits every healthy policy. Where it stays up at
        all, a change that the trainer's samples contradict is none either.
        """
        present = self.present
        for verdict in self.best():
            if verdict.hypothesis.edit is None and verdict.stays_up:
                return None  # no other does better
            if verdict.stays_up and (present is None or self._cures(verdict, present)):
                return verdict
        return None

    @property
    def ruled_out(self) -> Verdict | None:
        """The best change before the contract as it is that the trainer's samples contradict; None: there is none."""
        for verdict in self.best():
            if verdict.hypothesis.edit is None:
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
        """Of every cause its best edit, best first."""
        found: dict[str, Verdict] = {}
        for verdict in self.ordered:
            found.setdefault(verdict.hypothesis.cause, verdict)
        return list(found.values())

    def equals(self, verdict: Verdict) -> list[Verdict]:
        """Return changes of other causes that do as well: this trial cannot tell which is right."""
        limit = verdict.cost + _EQUAL * max(verdict.cost, 1.0)
        return [
            other
            for other in self.best()
            if other.hypothesis.edit is not None
            and other.hypothesis.cause != verdict.hypothesis.cause
            and other.stays_up
            and other.cost <= limit
        ]

    def alternatives(self, verdict: Verdict) -> list[Verdict]:
        """Other edits of the same cause, best first."""
        cause = verdict.hypothesis.cause
        return [other for other in self.ordered if other.hypothesis.cause == cause and other is not verdict]
