"""The search for the one edit that puts a contract right: on the samples of a trace, or in simulated episodes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from rich.console import Console
from rich.progress import track

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.doctor.edits import DOUBT, Edit, asymmetry, single_edits
from humanoid_sim.doctor.samples import Samples
from humanoid_sim.doctor.trial import Outcome, Simulations, Subject

_COMMANDS = np.array(
    [[0.5, 0.0, 0.5], [0.5, 0.0, 0.0], [0.0, 0.0, 0.5], [0.0, 0.0, -0.5], [0.0, 0.4, 0.0], [0.0] * 3, [-0.5, 0.0, 0.0]]
)  # m/s, m/s, rad/s, of the long run
_PHASE = 3.0  # s, of each of them
_SAVES = 0.2  # share of its errors that an edit must save where the robot stays up as it is
_AS_GOOD = 0.05  # share of the errors within which two edits are as good
_ASYMMETRIC = 0.25  # share of the errors that gains, scale or pose which differ between the sides count as
_PREDICTS = 0.5  # share of the prediction's error that an edit may leave
_EXACT = 0.01  # prediction's error below which there is nothing to explain
_RATES = (25.0, 30.0, 50.0, 60.0, 100.0, 200.0)  # Hz
_OFF_RATE = 1.25  # factor between two rates beyond which they differ
_THREADS = 2  # physics and inference release the interpreter
_UNSEEN = ("gains", "action scale", "action offset", "default pose")
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
    contract, more = subject.contract, samples.fitted(subject.contract)
    edits = single_edits(contract, subject.description, subject.motion, all_pairs=True, more=more)

    def predicted(tried: Sequence[Edit]) -> list[Row]:
        errors = [samples.prediction_error(edit.contract) for edit in tried]
        notes = [f"one simulated step misses the joint velocities' change by {error:.0%}" for error in errors]
        return sorted(map(Row, tried, errors, notes), key=lambda row: row.score)

    far = samples.differing(contract)
    if far.any():
        note = f"{far.sum()} of {len(far)} values differ from the trace's as it is: {samples.names(contract, far)}"
        left = sorted(((int(samples.differing(edit.contract).sum()), edit) for edit in edits), key=lambda item: item[0])
        answers = [edit for count, edit in left if not count]
        if answers:  # of several, the one with which the robot moves as in the trace
            return _found(predicted(answers), note)
        nearest = tuple(Row(edit, n, f"leaves {n} values that differ") for n, edit in left[:3] if n < far.sum())
        return Result("No single change agrees with the trace: several mistakes, or one of another kind", nearest, note)
    note, period = "every observation agrees with the trace's as it is", samples.period()
    if period and not 1.0 / _OFF_RATE < period / contract.policy_dt < _OFF_RATE:
        rate = min(_RATES, key=lambda each: abs(math.log(each * period)))
        edit = Edit(f"the policy runs at {rate:g} Hz", "rate", replace(contract, policy_dt=1.0 / rate))
        return _found([Row(edit, period, f"the joints moved for {period:.3f} s from sample to sample")], note)
    now = samples.prediction_error(contract)
    if _EXACT < now < math.inf:
        rows = predicted([edit for edit in edits if edit.family in _UNSEEN])
        if rows and rows[0].score < _PREDICTS * now:
            return _found(rows, f"{note}; one simulated step misses the joint velocities' change by {now:.0%}")
    return Result("Nothing wrong found: the contract agrees with the trace", (), note, is_healthy=True)


def search_episodes(subject: Subject, console: Console) -> Result:
    """Try every edit in one simulated episode, without support, with progress on a console.

    A long run of the contract as it is comes first.
    """
    contract, motion = subject.contract, subject.motion
    seconds = _PHASE * len(_COMMANDS) if motion is None else len(motion.frames) * contract.policy_dt
    long = Simulations(subject).run(contract, _COMMANDS, seconds)
    edits, idle = single_edits(contract, subject.description, motion), [Simulations(subject) for _ in range(_THREADS)]

    def run(edited: PolicyContract) -> Outcome:
        simulations = idle.pop()  # there is one for each thread
        outcome = simulations.run(edited)
        idle.append(simulations)
        return outcome

    contracts = [contract, *(edit.contract for edit in edits)]
    with ThreadPoolExecutor(_THREADS) as pool:
        tried = pool.map(run, contracts)
        now, *outcomes = track(tried, "changes", len(contracts), console=console, transient=True)
    return judge(contract, now, long, list(zip(edits, outcomes, strict=True)))


def judge(contract: PolicyContract, now: Outcome, long: Outcome, tried: Sequence[tuple[Edit, Outcome]]) -> Result:
    """Rank the edits by their errors, and decide whether the first does clearly better than the contract as it is.

    `now` and `long` are of the contract as it is, in the episode of the edits and in the long run.
    """

    def cost(edited: PolicyContract, outcome: Outcome, family: str = "") -> float:
        return outcome.cost * (1.0 + DOUBT.get(family, 0.0) + (_ASYMMETRIC if asymmetry(edited) else 0.0))

    note = _describe(now)
    if long.lost and not now.lost:
        note += f"; in the long run {_describe(long)}"
    if long.unanswered:
        note += f"; does not answer the command {', '.join(long.unanswered)}"
    up = [Row(edit, cost(edit.contract, out, edit.family), _describe(out)) for edit, out in tried if not out.lost]
    up.sort(key=lambda row: row.score)
    if up and (now.lost or up[0].score < (1.0 - _SAVES) * cost(contract, now)):
        return _found(up, note)
    if now.lost:
        return Result("No single change keeps the robot up: several mistakes, or its model", (), note)
    if long.lost:
        return Result("Lost in the long run, and no change does clearly better", tuple(up[:3]), note)
    return Result("Nothing wrong found: no change does clearly better", (), note, is_healthy=True)


def _describe(outcome: Outcome) -> str:
    if outcome.lost:
        return f"lost after {outcome.time_up:.1f} s: {outcome.lost}"
    parts = sorted(outcome.parts.items(), key=lambda item: -item[1])[:3]
    return f"stays up; errors {outcome.cost:.1f} ({', '.join(f'{name} {value:.1f}' for name, value in parts)}, …)"
