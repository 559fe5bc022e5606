"""The search for the one edit that puts a contract right: on the samples of a trace, or in simulated episodes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from rich.console import Console
from rich.progress import track

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.doctor.edits import DOUBT, Edit, asymmetry, single_edits
from humanoid_sim.doctor.samples import Samples
from humanoid_sim.doctor.trial import Subject, episode_errors, run_episode
from humanoid_sim.regress.results import Episode
from humanoid_sim.regress.suite import REACHED

_SECONDS, _LONG = 4.0, 20.0  # s, of the episodes of the edits, and of the contract as it is
_NOTICEABLE = 1.0  # errors below which nothing is wrong with a robot that stays up
_SAVES = 0.2  # share of its errors that an edit must save where the robot stays up as it is
_ANSWERED = 0.2  # share of a commanded speed that a policy which answers it reaches
_AS_GOOD = 0.05  # share of the errors within which two edits are as good
_ASYMMETRIC = 0.25  # share of the errors that gains, scale or pose which differ between the sides count as
_PREDICTS = 0.5  # share of the prediction's error that an edit may leave
_EXACT = 0.01  # prediction's error below which there is nothing to explain
_THREADS = 2  # physics and inference release the interpreter
_UNSEEN = ("gains", "action scale", "action offset", "default pose", "rate")
"""Families that no observation shows: they change how the robot moves."""


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """One edit in the ranking."""

    edit: Edit
    score: float  # smaller is better
    note: str


@dataclass(frozen=True, slots=True)
class Result:
    """Outcome of a search."""

    verdict: str
    rows: tuple[Row, ...] = ()  # edits that may be right, best first
    note: str = ""
    finding: Edit | None = None
    is_healthy: bool = False


def _found(rows: Sequence[Row], note: str) -> Result:
    best = tuple(row for row in rows if row.score <= rows[0].score * (1.0 + _AS_GOOD))
    return Result(f"Most likely {best[0].edit.name}", best, note, best[0].edit)


def search_trace(subject: Subject, samples: Samples) -> Result:
    """Try every edit on the samples of the trainer's environment; a finding agrees with all of them."""
    contract = subject.contract
    edits = single_edits(contract, subject.description, subject.checkpoint.motion, all_pairs=True)
    edits = (*edits, *samples.fitted_poses(contract))

    def predicted(tried: Sequence[Edit]) -> list[Row]:
        errors = [samples.prediction_error(edit.contract) for edit in tried]
        notes = [_missed(error) or "agrees with every sample" for error in errors]
        return sorted(map(Row, tried, errors, notes), key=lambda row: row.score)

    if differs := samples.disagreement(contract):
        note = f"as it is, it differs from the trace: {differs}"
        answers = [edit for edit in edits if not samples.disagreement(edit.contract)]
        if answers:  # of several, the one with which the robot moves as in the trace
            return _found(predicted(answers), note)
        return Result("No single change agrees with the trace: several mistakes, or one of another kind", (), note)
    now = samples.prediction_error(contract)
    note = "; ".join(filter(None, ("every observation agrees with the trace's as it is", _missed(now))))
    if gains := samples.fitted_gains(contract):
        return _found([Row(gains[0], 0.0, "follows from the array effort")], note)
    if _EXACT < now < math.inf:
        rows = predicted([edit for edit in edits if edit.family in _UNSEEN])
        if rows and rows[0].score < _PREDICTS * now:
            return _found(rows, note)
    return Result("Nothing wrong found: the contract agrees with the trace", (), note, is_healthy=True)


def _missed(error: float) -> str:
    known = f"one simulated step misses the joint velocities' change by {error:.0%}"
    return known if math.isfinite(error) else ""


def search_episodes(subject: Subject, console: Console) -> Result:
    """Try every edit in one simulated episode, without support, with progress on a console."""
    contract = subject.contract
    edits = single_edits(contract, subject.description, subject.checkpoint.motion)
    tried = [(subject, _LONG), (subject, _SECONDS), *((subject.under(edit.contract), _SECONDS) for edit in edits)]
    with ThreadPoolExecutor(_THREADS) as pool:
        running = pool.map(lambda one: run_episode(*one), tried)
        long, now, *episodes = track(running, "changes", len(tried), console=console, transient=True)
    return judge(contract, now, long, list(zip(edits, episodes, strict=True)))


def judge(contract: PolicyContract, now: Episode, long: Episode, tried: Sequence[tuple[Edit, Episode]]) -> Result:
    """Rank the edits by their errors, and decide whether the first does clearly better than the contract as it is.

    `now` and `long` are of the contract as it is, as long as those of the edits, and longer.
    """

    def cost(edited: PolicyContract, episode: Episode, family: str = "") -> float:
        errors = sum(episode_errors(episode).values())
        return errors * (1.0 + DOUBT.get(family, 0.0) + (_ASYMMETRIC if asymmetry(edited) else 0.0))

    note = _describe(now)
    if long.failure and not now.failure:
        note += f"; in a longer episode {_describe(long)}"
    for name in REACHED:
        reached = long.metrics.get(name)
        if reached is not None and reached < _ANSWERED:
            note += f"; in a longer episode it does not answer the command ({name} {reached:.0%})"
    up = [Row(edit, cost(edit.contract, end, edit.family), _describe(end)) for edit, end in tried if not end.failure]
    up.sort(key=lambda row: row.score)
    present = cost(contract, now)
    if up and (now.failure or (present > _NOTICEABLE and up[0].score < (1.0 - _SAVES) * present)):
        return _found(up, note)
    if now.failure:
        return Result("No single change keeps the robot up: several mistakes, or its model", (), note)
    if long.failure:
        return Result("Lost after a while, and no change does clearly better", tuple(up[:3]), note)
    return Result("Nothing wrong found: no change does clearly better", (), note, is_healthy=True)


def _describe(episode: Episode) -> str:
    if episode.failure:
        return f"lost after {episode.duration:.1f} s: {episode.failure}"
    errors = episode_errors(episode)
    parts = ", ".join(f"{name} {value:.1f}" for name, value in [*errors.items()][:3])
    return f"stays up; errors {sum(errors.values()):.1f} ({parts}, …)"
