"""What a person reads on the terminal."""

from __future__ import annotations

from collections.abc import Mapping

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from humanoid_sim.regress.results import (
    Candidate,
    Comparison,
    PolicyRun,
    Results,
    describe_detectable,
    displayed_unit,
    quantity,
)

__all__ = ["show_candidate", "show_detectable", "show_run", "show_verdict"]

_COLOURS = {"worse": "red", "better": "green", "same": "default", "unclear": "yellow", "unmeasured": "yellow"}
_FAILURES_SHOWN = 5


def show_detectable(console: Console, results: Results) -> None:
    """How small a change the suite can find: before any candidate has run."""
    if not results.detectable:
        return
    table = Table(
        title=f"{escape(results.suite.name)}: found with a probability of {results.detectable[0].power:.0%}, or sooner",
        title_justify="left",
    )
    for heading in ("metric", "baseline", "tolerated", "found from"):
        table.add_column(heading, justify="left" if heading == "metric" else "right")
    for row in results.detectable:
        metric = results.metric(row.metric)
        table.add_row(
            row.metric,
            quantity(row.baseline, metric.unit),
            quantity(row.tolerance, metric.unit),
            describe_detectable(metric, row),
        )
    console.print(table)


def show_run(console: Console, results: Results, run: PolicyRun) -> None:
    """What a policy did, where there is nothing to compare it with."""
    table = Table(title=escape(run.name), title_justify="left")
    table.add_column("metric")
    for heading in ("mean", "least", "greatest"):
        table.add_column(heading, justify="right")
    for metric in results.metrics:
        values = [value for episode in run.episodes if (value := episode.metrics[metric.name]) is not None]
        numbers = (sum(values) / len(values), min(values), max(values)) if values else (None, None, None)
        table.add_row(metric.name, *(quantity(number, metric.unit) for number in numbers))
    console.print(table)
    _show_trouble(console, run, {})


def show_candidate(console: Console, results: Results, candidate: Candidate) -> None:
    """A policy beside the baseline."""
    table = Table(title=f"{escape(candidate.run.name)} against the baseline", title_justify="left")
    table.add_column("metric", no_wrap=True)
    for heading in ("baseline", "candidate", "change"):
        table.add_column(heading, justify="right")
    table.add_column("verdict", no_wrap=True)
    for comparison in candidate.comparisons:
        unit = results.metric(comparison.metric).unit
        colour = _COLOURS[comparison.verdict]
        table.add_row(
            comparison.metric,
            quantity(comparison.baseline, unit),
            quantity(comparison.candidate, unit),
            _change(comparison, unit),
            f"[{colour}]{comparison.verdict}[/]",
        )
    console.print(table)
    if candidate.comparisons and not candidate.comparisons[0].paired:
        console.print("other seeds than the baseline's: compared case by case, not pair by pair")
    _show_trouble(console, candidate.run, {margin.axis: margin.verdict for margin in candidate.margins})


def _change(comparison: Comparison, unit: str) -> str:
    """The change, with the farther end of its interval: in shares of the baseline, if there is one."""
    change, low, high = comparison.change, comparison.low, comparison.high
    if change is None or low is None or high is None:
        return "-"
    reach = max(high - change, change - low)
    base = abs(comparison.baseline or 0.0)
    if base and unit != "share":
        return f"{100.0 * change / base:+.1f} ± {100.0 * reach / base:.1f} %"
    factor, shown = displayed_unit(unit)
    return f"{factor * change:+.3g} ± {factor * reach:.2g} {shown}"


def _show_trouble(console: Console, run: PolicyRun, verdicts: Mapping[str, str]) -> None:
    """The episodes that failed, and how much of each disturbance was borne; `verdicts` on that by axis, if any."""
    failures = run.failures
    if failures:
        console.print(f"{len(failures)} of {len(run.episodes)} episodes failed:")
        for episode in failures[:_FAILURES_SHOWN]:
            line = f"  {episode.label}, after {episode.duration:.2f} s: {episode.failure}"
            console.print(line, markup=False, highlight=False, soft_wrap=True)
        if len(failures) > _FAILURES_SHOWN:
            console.print(f"  and {len(failures) - _FAILURES_SHOWN} more")
    if not run.margins:
        return
    table = Table(title="robustness margins", title_justify="left")
    table.add_column("disturbance")
    table.add_column("borne up to", justify="right")
    table.add_column("fails")
    if verdicts:
        table.add_column("verdict")
    for margin in run.margins:
        borne = quantity(margin.limit, margin.unit)
        verdict = verdicts.get(margin.axis, "")
        reason = (
            "" if margin.reached_end else f"at {quantity(margin.levels[-1], margin.unit)}: {escape(margin.failure)}"
        )
        cells = [margin.axis, f"{borne} or more" if margin.reached_end else borne, reason]
        if verdicts:
            cells.append(f"[{_COLOURS[verdict]}]{verdict}[/]" if verdict else "")
        table.add_row(*cells)
    console.print(table)


def show_verdict(console: Console, results: Results, candidate: Candidate) -> None:
    """One line: pass or fail, naming the metrics."""
    name = candidate.run.name
    if results.baseline is None:
        failed = len(candidate.run.failures)
        line = f"{name}: {len(candidate.run.episodes)} episodes, {failed} failed; no baseline to compare with"
    elif candidate.passed:
        unclear = [comparison.metric for comparison in candidate.comparisons if comparison.verdict == "unclear"]
        doubt = f"; more seeds would tell for sure: {', '.join(unclear)}" if unclear else ""
        line = f"PASS {name}{doubt}"
    else:
        line = f"FAIL {name}: worse: {', '.join(candidate.worse)}"
    console.print(line, markup=False, highlight=False, soft_wrap=True)
