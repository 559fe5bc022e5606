"""Output for a person on the terminal."""

from __future__ import annotations

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from humanoid_sim.regress.compare import FEW_SEEDS
from humanoid_sim.regress.results import Candidate, Comparison, PolicyRun, Results, quantity

_COLOURS = {
    "lost": "red",
    "worse beyond tolerance": "red",
    "better": "green",
    "no difference seen": "default",
}
"""Colours of verdicts; the others are yellow."""
_FAILURES_SHOWN = 5


def say(console: Console, line: str) -> None:
    """Print a line as it is, however wide the terminal is."""
    console.print(line, markup=False, highlight=False, soft_wrap=True)


def _numbers(*headings: str) -> list[Column]:
    return [Column(heading, justify="right") for heading in headings]


def show_run(console: Console, results: Results, run: PolicyRun) -> None:
    """Show what a policy did, where there is nothing to compare it with."""
    table = Table("metric", *_numbers("mean", "least", "greatest"), title=escape(run.name), title_justify="left")
    for metric in results.metrics:
        table.add_row(metric.name, *(quantity(value, metric.unit) for value in run.summary(metric.name)))
    console.print(table)
    whole = len(run.episodes) - len(run.failures)
    if whole and any(episode.metrics[metric.name] is None for episode in run.failures for metric in results.metrics):
        console.print(f"Errors are of the {whole} episodes that did not fail.")
    _show_failures(console, None, Candidate(run=run, passed=True))


def show_candidate(console: Console, results: Results, candidate: Candidate) -> None:
    """Show a policy beside the baseline."""
    paired = all(comparison.paired for comparison in candidate.comparisons)
    table = Table(
        Column("metric", no_wrap=True),
        "verdict",
        *_numbers("baseline", "candidate", "change"),
        title=f"{escape(candidate.run.name)} against the baseline",
        title_justify="left",
        box=box.SIMPLE_HEAD,  # all columns within 80 characters
        padding=(0, 1, 0, 0),
    )
    for comparison in candidate.comparisons:
        unit = results.metric(comparison.metric).unit
        table.add_row(
            comparison.metric,
            _coloured(comparison.verdict),
            quantity(comparison.baseline, unit),
            quantity(comparison.candidate, unit),
            _change(comparison, unit),
        )
    for text, names in candidate.left_out.items():
        say(console, f"without {text}: {', '.join(names)}")
    console.print(table)
    if not paired:
        console.print("other seeds than the baseline's: compared case by case, not pair by pair", highlight=False)
    _show_failures(console, results.baseline, candidate)


def _change(comparison: Comparison, unit: str) -> str:
    """Return the change with the farther end of its interval, as shares of a baseline that has one."""
    change, low, high = comparison.change, comparison.low, comparison.high
    if change is None or low is None or high is None:
        return "-"
    reach = comparison.share(max(high - change, change - low), unit).removeprefix("+")
    return f"{comparison.share(change, unit).removesuffix(' %')} ± {reach}"


def _coloured(verdict: str) -> str:
    """Return a verdict with its colour, as markup."""
    return f"[{_COLOURS.get(verdict, 'yellow')}]{verdict}[/]"


def _show_failures(console: Console, baseline: PolicyRun | None, candidate: Candidate) -> None:
    """Show the episodes that failed."""
    run, failures = candidate.run, candidate.run.failures
    if not failures:
        return
    before = f" (the baseline: {len(baseline.failures)} of {len(baseline.episodes)})" if baseline else ""
    console.print(f"{len(failures)} of {len(run.episodes)} episodes failed{before}:")
    for episode in failures[:_FAILURES_SHOWN]:
        say(console, f"  {episode.label}, after {episode.duration:.2f} s: {episode.failure}")
    if len(failures) > _FAILURES_SHOWN:
        console.print(f"  and {len(failures) - _FAILURES_SHOWN} more")


def show_verdict(console: Console, results: Results, candidate: Candidate) -> None:
    """Print pass, fail or undecided, and the metrics of each verdict with what was seen of them."""
    name = candidate.run.name
    if results.baseline is None:
        failed = len(candidate.run.failures)
        line = f"{name}: {len(candidate.run.episodes)} episodes, {failed} failed; no baseline to compare with"
    else:
        word = "PASS" if candidate.passed else "UNDECIDED" if candidate.undecided else "FAIL"
        few = f"{candidate.few_seeds} seeds are too few to judge {', '.join(candidate.unclear)}; {FEW_SEEDS} or more"
        parts = [f"{few} are expected"] if word == "UNDECIDED" else []
        for verdict, members in results.verdicts(candidate):
            parts.append(f"{verdict}: {', '.join(' '.join(member).strip() for member in members)}")
        line = f"{word} {name}: " + "\n  ".join(parts)
    say(console, line)
