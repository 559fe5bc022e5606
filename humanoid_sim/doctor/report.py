"""The ranking for a person, as a table, a conclusion and what to write into a contract.yaml; for programs, as JSON."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.doctor.overrides import Pasting, change_lines
from humanoid_sim.doctor.ranking import Ranking, Verdict

_EQUALS = 5
"""Changes that are named as good as the first."""
_NOTICEABLE = "each is about 1 where an onlooker would begin to notice it"


def conclusion(ranking: Ranking) -> str:
    """Say in a few sentences what the ranking shows: the cause, what explains it as well, and what was not tried."""
    text = _cause(ranking)
    equals = [] if ranking.finding is None else ranking.equals(ranking.finding)
    if equals:
        names = ", ".join(f"'{verdict.hypothesis.name}'" for verdict in equals[:_EQUALS])
        more = f" and {len(equals) - _EQUALS} more" if len(equals) > _EQUALS else ""
        text += f" As good in this trial, which cannot tell them apart: {names}{more}."
    if ranking.tried < ranking.known:
        text += f" Not tried: {ranking.known - ranking.tried} of {ranking.known} changes."
    return text


def _cause(ranking: Ranking) -> str:
    best, present, finding = ranking.best(), ranking.present, ranking.finding
    if not best or present is None:
        return "Nothing has been tried yet."
    if not any(verdict.stays_up for verdict in best):
        return (
            "Nothing in this space keeps the robot up, so the ranking is only a hint. Look at the robot model (joint "
            "armature, contacts, effort limits), at the gains, and for more than two mistakes at once."
        )
    if finding is None:
        return _nothing_wrong(ranking, present)
    if present.stays_up and ranking.is_slight(finding):
        return (
            f"The robot stays up with the contract as it is. '{finding.hypothesis.name}' does "
            f"{ranking.saved(finding):.0%} better, which is little: believe it only if the training configuration says "
            "so."
        )
    before = f"does {ranking.saved(finding):.0%} better" if present.stays_up else "keeps the robot up"
    if not finding.is_inconspicuous:
        return (
            f"Most likely: {finding.hypothesis.explanation}. With that it {before}, but not yet well: there may be "
            "another mistake beside it."
        )
    return f"Most likely: {finding.hypothesis.explanation}. With that it {before}."


def _nothing_wrong(ranking: Ranking, present: Verdict) -> str:
    """Say that the contract is not to blame, and what does clearly better without being believed."""
    nothing = "Nothing wrong found in this space: "
    up = [verdict for verdict in ranking.best() if verdict.stays_up]
    better = min(up, key=lambda verdict: verdict.cost, default=present)
    if ranking.is_slight(better):
        is_best = ranking.best()[0] is present
        return nothing + ("the contract as it is does best." if is_best else "no change does clearly better.")
    ruled_out = ranking.ruled_out
    if ruled_out is not None:
        return (
            f"{nothing}the wiring agrees with the trainer's samples, which rule out '{ruled_out.hypothesis.name}', "
            f"{ranking.saved(ruled_out):.0%} better; small gains like these come from an immature policy."
        )
    if not present.is_inconspicuous:
        return (
            f"Nothing is certain. '{better.hypothesis.name}' does {ranking.saved(better):.0%} better, but such a "
            "change may suit a robot without being what its policy was trained with: compare it with the training "
            "configuration."
        )
    worse = better.worsens(present)
    cost = f", though worse in {' and '.join(worse)}" if worse else ""
    return (
        f"{nothing}the run as it is shows nothing noticeable. It also runs with '{better.hypothesis.name}', "
        f"{ranking.saved(better):.0%} better{cost}; most healthy policies have such a change."
    )


@dataclass(frozen=True)
class Examination:
    """Outcome of a search."""

    ranking: Ranking
    contract: PolicyContract
    pasting: Pasting
    """Place where a change is to be written."""
    is_interrupted: bool = False
    """Ctrl-C ended it."""
    samples_problem: str = ""
    """Difference between the trainer's samples in the checkpoint and the contract; empty if there is none."""

    def print(self, console: Console, rows: int) -> None:
        """Print the best of every cause, the conclusion, and what the first would have you write."""
        best = self.ranking.best()
        parts = ", ".join(best[0].outcome.quality) if best else ""  # they depend on what the policy is to do
        table = Table(
            Column(justify="right"),
            "hypothesis",
            Column("time up", justify="right"),
            Column("quality", justify="right"),
            "what it changes",
            title="by time up, then by quality (smaller is better); unlikely causes rank lower",
            title_justify="left",
            caption=f"quality: the sum of {parts}; {_NOTICEABLE}" if parts else None,
            caption_justify="left",
        )
        for rank, verdict in enumerate(best, 1):
            if rank <= rows or verdict.hypothesis.edit is None:
                table.add_row(str(rank), *_row(verdict, self.contract))
        console.print(table)
        if self.samples_problem:
            told = f"The trainer's own samples in the checkpoint contradict the contract. {self.samples_problem}"
            console.print(escape(told), style="bold", soft_wrap=True)
        console.print(escape(conclusion(self.ranking)), style="bold", soft_wrap=True)
        finding = self.ranking.finding
        if finding is None:
            return
        text = self.pasting.text(self.contract, finding.hypothesis.contract)
        console.print(text, soft_wrap=True, end="", markup=False, emoji=False, highlight=False)
        others = [verdict.hypothesis.name for verdict in self.ranking.alternatives(finding) if verdict.stays_up]
        if others:
            console.print(f"[dim]of the same cause, and up as well: {escape(', '.join(others))}[/dim]", soft_wrap=True)

    def document(self) -> dict[str, Any]:
        """Return everything as plain values, for JSON."""
        ranking = self.ranking
        return {
            "complete": not self.is_interrupted,
            "samples_problem": self.samples_problem,
            "seconds": round(ranking.seconds, 1),
            "tried": ranking.tried,
            "known": ranking.known,
            "healthy": ranking.is_healthy,
            "conclusion": conclusion(ranking),
            "as_good": [each.hypothesis.name for each in (ranking.equals(ranking.finding) if ranking.finding else ())],
            "file": str(self.pasting.file),
            "ranking": [self._entry(rank, verdict) for rank, verdict in enumerate(ranking.best(), 1)],
        }

    def _entry(self, rank: int, verdict: Verdict) -> dict[str, Any]:
        hypothesis = verdict.hypothesis
        return {
            "rank": rank,
            "hypothesis": hypothesis.name,
            "cause": hypothesis.cause,
            "explanation": hypothesis.explanation,
            "stays_up": verdict.stays_up,
            "time_up": verdict.time_up,
            "seconds": verdict.outcome.seconds,
            "lost": verdict.outcome.lost,
            "quality": verdict.cost,
            "parts": dict(verdict.outcome.quality),
            "changes": change_lines(self.contract, hypothesis.contract),
            "override": self.pasting.override(self.contract, hypothesis.contract),
            "alternatives": [other.hypothesis.name for other in self.ranking.alternatives(verdict)],
        }


def _row(verdict: Verdict, contract: PolicyContract) -> tuple[str, ...]:
    outcome = verdict.outcome
    color = "green" if verdict.stays_up else "yellow" if verdict.time_up > 0.5 else "red"
    reason = f"\n[dim]{escape(outcome.lost)}[/dim]" if outcome.lost else ""
    name = escape(verdict.hypothesis.name)
    return (
        f"[bold]{name}[/bold]" if verdict.hypothesis.edit is None else f"{name}{reason}",
        f"[{color}]{outcome.time_up:.1f} of {outcome.seconds:g} s[/]",
        f"{verdict.cost:.2f}" if verdict.stays_up else "–",
        escape("\n".join(change_lines(contract, verdict.hypothesis.contract))),
    )
