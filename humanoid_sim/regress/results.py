"""Results of a regression run: frozen structs that are JSON as they stand.

`Results` is what `--json` prints and what the report is made from; one `PolicyRun` alone is a baseline file. Numbers
that do not exist (an error of an episode that failed in its first step) are None, in JSON null.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal, get_args

import msgspec

Verdict = Literal[
    "lost",
    "worse beyond tolerance",
    "worse, perhaps beyond tolerance",
    "unclear",
    "worse within tolerance",
    "better",
    "no difference seen",
    "unmeasured",
]
"""Verdict on one metric, the most urgent first. Where it is worse or better, the interval of the worsening excludes 0,
and lies beyond the tolerance, reaches across it, or ends within it. Where the interval holds 0, no difference is seen
if it ends within the tolerance; otherwise it is unclear, because the episodes are too few. `unmeasured`: there are no
episodes to compare; `lost`: the baseline has the metric, and no episode of the candidate does."""
FAILING: tuple[Verdict, ...] = ("lost", "worse beyond tolerance")
"""Verdicts that fail a candidate."""
OPEN: tuple[Verdict, ...] = ("worse, perhaps beyond tolerance", "unclear")
"""Verdicts that more seeds would settle; they fail a candidate with `--strict`."""
_LISTED = 3
"""Episodes that a sentence names."""


class MetricInfo(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Meaning of a metric."""

    name: str
    """Such as `body_position_error`."""
    unit: str
    """Such as `m`; `share` for a share of the episodes, between 0 and 1."""
    better: Literal["lower", "higher"]
    summary: str
    """One sentence for a person."""


class SuiteInfo(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The suite that was run, and how much of it."""

    name: str
    summary: str
    task: Literal["tracking", "velocity", "piano"]
    robot: str
    cases: tuple[str, ...]
    """Names of the motions or commands, in the suite's order."""
    seeds: tuple[int, ...]
    """Each case is run once with each of them."""
    duration: float
    """s, of the longest episode."""


class Episode(msgspec.Struct, frozen=True, kw_only=True):
    """One rollout of one policy: a case with a seed."""

    case: str
    seed: int
    steps: int
    """Policy steps until the end, or until the failure."""
    duration: float
    """s of simulated time that the episode lasted."""
    failure: str = ""
    """Reason why the episode failed, in one line; empty if it did not."""
    kind: Literal["", "fault", "lost"] = ""
    """Kind of failure. `fault`: the controller's own refusal (a non-finite or too large action or observation), or a
    simulation that became non-finite. `lost`: the robot fell, or strayed too far from what it should follow."""
    metrics: Mapping[str, float | None]
    """By the metric's name, in its unit; None: not measured."""

    @property
    def label(self) -> str:
        """Such as `wave, seed 3`."""
        return f"{self.case}, seed {self.seed}"


class PolicyRun(msgspec.Struct, frozen=True, kw_only=True):
    """One policy over the whole suite. Written to a file it is a baseline; other fields of a file are ignored."""

    format: Literal["humanoid_sim.regress/1"] = "humanoid_sim.regress/1"
    name: str
    """Name of the policy: unique within a run."""
    source: str
    """The file that it came from."""
    sha256: str
    """Digest of that file."""
    suite: str
    """The suite's name."""
    case_digests: Mapping[str, str]
    """By case the SHA-256 of all that its episodes depend on beside policy and seed: only equals are compared."""
    episodes: tuple[Episode, ...]
    """Case by case in the suite's order, within a case seed by seed."""
    definitions: Mapping[str, str] = {}
    """Meanings of its figures, as `humanoid_sim.evaluation.failure` had it: only equals are compared."""
    batching: str = ""
    """Batching of inference: `in batches`, or `row by row: …` and why not."""
    versions: Mapping[str, str] = {}
    """Versions of the packages that the numbers depend on, and of the platform."""

    @property
    def failures(self) -> tuple[Episode, ...]:
        """The episodes that failed."""
        return tuple(episode for episode in self.episodes if episode.failure)

    def summary(self, metric: str) -> tuple[float | None, float | None, float | None]:
        """Return the mean, least and greatest value of the episodes that have a metric; None where none has."""
        values = [value for episode in self.episodes if (value := episode.metrics[metric]) is not None]
        return (sum(values) / len(values), min(values), max(values)) if values else (None, None, None)


class CaseComparison(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One metric in one case: a mean over all cases hides what a single one of them does."""

    case: str
    verdict: Verdict
    baseline: float
    candidate: float
    change: float
    """Candidate less baseline, in the metric's unit."""


class Comparison(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One metric of a candidate against the baseline. Changes are candidate less baseline, in the metric's unit."""

    metric: str
    verdict: Verdict
    baseline: float | None
    """Mean over the episodes that are compared; cases weigh equally."""
    candidate: float | None
    change: float | None = None
    low: float | None = None
    """Lower end of the confidence interval of the change."""
    high: float | None = None
    tolerance: float | None = None
    """The worsening that the suite lets pass, a positive number."""
    episodes: int
    """Pairs that are compared, or, unpaired, the candidate's episodes."""
    paired: bool
    """By case and seed; where the baseline was run with other seeds, the two are compared case by case instead."""
    left_out: int = 0
    """Pairs (unpaired: episodes of both) that have no value because an episode failed."""
    cases: tuple[CaseComparison, ...] = ()
    """Case by case; one that is worse makes the whole metric worse. Empty for shares of failed episodes."""
    new_failures: tuple[str, ...] = ()
    """Episodes behind a share of failures: the candidate's, in cases in which none of the baseline's failed. One is
    enough to make the metric worse."""

    @property
    def reasons(self) -> str:
        """Say what makes the metric worse whatever its mean is, such as `wave alone by +17.1 %`; '' if nothing does."""
        found = []
        if self.new_failures:
            more = f" and {len(self.new_failures) - _LISTED} more" if len(self.new_failures) > _LISTED else ""
            found.append(f"{len(self.new_failures)} new: {'; '.join(self.new_failures[:_LISTED])}{more}")
        alone = [case for case in self.cases if case.verdict in FAILING]
        if alone and len(alone) < len(self.cases):
            words = (
                f"{c.case} by {100.0 * c.change / abs(c.baseline):+.1f} %" if c.baseline else c.case for c in alone
            )
            found.append(f"in {', '.join(words)}")
        return "; ".join(found)

    @property
    def without(self) -> str:
        """Such as `5 of 48 pairs in which an episode failed`."""
        if not self.paired:
            return f"{self.left_out} episodes that failed"
        return f"{self.left_out} of {self.left_out + self.episodes} pairs in which an episode failed"

    def share(self, value: float | None, unit: str) -> str:
        """Return a change such as `+8.0 %` of the baseline, and where it has no such share, the value itself."""
        if value is None or not self.baseline or unit == "share":
            return quantity(value, unit, signed=True)
        return f"{100.0 * value / abs(self.baseline):+.1f} %"

    @property
    def relative(self) -> float | None:
        """Change as a share of the baseline; None where that is 0 or unknown."""
        if self.change is None or not self.baseline:
            return None
        return self.change / abs(self.baseline)


class Candidate(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One policy under test."""

    run: PolicyRun
    passed: bool
    """No metric is worse beyond its tolerance or lost; with `--strict`, none is open either, nor with few seeds: see
    `undecided`."""
    comparisons: tuple[Comparison, ...] = ()
    """Empty without a baseline."""
    few_seeds: int | None = None
    """Number of seeds of each case, where that is fewer than a verdict takes."""

    @property
    def undecided(self) -> bool:
        """Nothing is shown to be worse beyond its tolerance, but the seeds are too few to judge some metrics."""
        return self.few_seeds is not None and not self.worse and bool(self.unclear)

    @property
    def worse(self) -> tuple[str, ...]:
        """Names of the metrics that fail the candidate."""
        return tuple(comparison.metric for comparison in self.comparisons if comparison.verdict in FAILING)

    @property
    def left_out(self) -> dict[str, list[str]]:
        """Names of metrics, by what they lack, such as `5 of 48 pairs in which an episode failed`."""
        found: dict[str, list[str]] = {}
        for comparison in self.comparisons:
            if comparison.left_out:
                found.setdefault(comparison.without, []).append(comparison.metric)
        return found

    @property
    def unclear(self) -> tuple[str, ...]:
        """Names of the metrics that more seeds would have to decide."""
        return tuple(comparison.metric for comparison in self.comparisons if comparison.verdict in OPEN)


class Results(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everything that one call of `regress` found."""

    suite: SuiteInfo
    metrics: tuple[MetricInfo, ...]
    """In the order in which they are shown."""
    confidence: float
    """Probability that none of a candidate's intervals misses its change, shared among the metrics."""
    resamples: int
    """Resamples of the bootstrap."""
    baseline: PolicyRun | None
    candidates: tuple[Candidate, ...]
    strict: bool = False
    """A metric whose verdict is open fails."""
    warnings: tuple[str, ...] = ()
    """Cautions for reading the verdicts, such as few seeds."""
    arguments: tuple[str, ...] = ()
    """Words of the command line that say how an episode is run: suite, robot and contract."""

    @property
    def passed(self) -> bool:
        """Return whether every candidate passed."""
        return all(candidate.passed for candidate in self.candidates)

    @property
    def verdict(self) -> Literal["PASSED", "UNDECIDED", "FAILED"]:
        """In a word; undecided where nothing else kept a candidate from passing."""
        if self.passed:
            return "PASSED"
        undecided = all(candidate.passed or candidate.undecided for candidate in self.candidates)
        return "UNDECIDED" if undecided and not self.strict else "FAILED"

    def verdicts(self, candidate: Candidate) -> list[tuple[str, list[tuple[str, str]]]]:
        """Return each verdict, the most urgent first, with the metrics that have it and what was seen of each.

        Such as `("worse within tolerance", [("effort", "+1.3 % (+1.1 to +1.5 %)")])`.
        """
        found: dict[str, list[tuple[str, str]]] = {verdict: [] for verdict in get_args(Verdict)}
        for seen in candidate.comparisons:
            unit, words = self.metric(seen.metric).unit, ""
            if seen.change is not None and seen.verdict != "no difference seen":
                change, low, high = (seen.share(value, unit) for value in (seen.change, seen.low, seen.high))
                reasons = f"; {seen.reasons}" if seen.reasons else ""
                words = f"{change} ({low.removesuffix(' %')} to {high}{reasons})"
            found[seen.verdict].append((seen.metric, words))
        return [(verdict, members) for verdict, members in found.items() if members]

    def metric(self, name: str) -> MetricInfo:
        """Return the metric of that name; KeyError if there is none."""
        return {metric.name: metric for metric in self.metrics}[name]


_SHOWN = {"m": (1e3, "mm"), "rad": (180.0 / math.pi, "°"), "rad/s": (180.0 / math.pi, "°/s"), "share": (100.0, "%")}
"""By unit what to multiply a value by for a person, and the unit that it then has."""


def quantity(value: float | None, unit: str, *, signed: bool = False) -> str:
    """Return a value with the unit that a person reads it in, such as `12.1 mm`; `-` where there is none."""
    if value is None or math.isnan(value):
        return "-"
    factor, shown = _SHOWN.get(unit, (1.0, unit))
    gap = "" if shown in ("°", "×") else " "
    return f"{factor * value:{'+' if signed else ''}.3g}{gap}{shown}"


def describe_change(metric: MetricInfo, comparison: Comparison) -> str:
    """Such as `12.1 mm, was 10.3 mm: +1.8 mm (+17.5 %), between +1.5 and +2.1 mm; tolerated: 0.515 mm`."""
    unit = metric.unit
    text = f"{quantity(comparison.candidate, unit)}, was {quantity(comparison.baseline, unit)}"
    if comparison.change is not None:
        relative = "" if comparison.relative is None else f" ({100.0 * comparison.relative:+.1f} %)"
        text += (
            f": {quantity(comparison.change, unit, signed=True)}{relative}, between "
            f"{quantity(comparison.low, unit, signed=True)} and {quantity(comparison.high, unit, signed=True)}; "
            f"tolerated: {quantity(comparison.tolerance, unit)}"
        )
    if comparison.left_out:
        text += f"; without {comparison.without}"
    return f"{text}; {comparison.reasons}" if comparison.reasons else text
