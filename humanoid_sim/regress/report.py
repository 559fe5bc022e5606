"""Report of a run for a person: one self-contained HTML page of tables."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping, Sequence
from html import escape

from humanoid_sim.regress.recordings import recording_name
from humanoid_sim.regress.results import FAILING, Candidate, PolicyRun, Results, quantity

_STYLE = """
body { margin: 2rem auto; padding: 0 1.5rem; max-width: 72rem; font: 15px/1.5 system-ui, sans-serif; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 0.9rem; }
th, td { padding: 0.25rem 0.6rem; text-align: right; border-bottom: 1px solid #8884; }
th:first-child, td:first-child { text-align: left; }
.worse { color: #c42f3d; font-weight: bold; } .better { color: #1e8a4f; } .open { color: #a87800; }
pre { overflow-x: auto; }
"""
_CLASSES: Mapping[str, str] = {
    **dict.fromkeys(FAILING, "worse"),
    "better": "better",
    "no difference seen": "",
    "unmeasured": "",
}
"""Style class of a verdict; the others are `open`."""
_COMPARED = ("metric", "verdict", "baseline", "candidate", "change", "from", "to", "tolerated", "because")


def report_page(results: Results) -> str:
    """Return the page; the same results give the same page, to the byte."""
    suite, title = results.suite, f"Regression: {results.suite.name}"
    cases = f"{len(suite.cases)} cases × {len(suite.seeds)} seeds, {suite.duration:g} s at most, on {suite.robot}"
    verdict = "No baseline was given: these are values, not verdicts." if results.baseline is None else results.verdict
    lines = [
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"/><title>{escape(title)}</title>',
        f"<style>{_STYLE}</style></head><body><h1>{escape(title)}</h1>",
        f"<p>{escape(suite.summary or suite.task)}: {escape(cases)}</p>",
        f'<p class="{"" if results.passed else "worse"}">{verdict}</p>',
        *(f'<p class="open">{escape(warning)}</p>' for warning in results.warnings),
    ]
    for candidate in results.candidates:
        lines += _candidate(results, candidate)
    return "\n".join([*lines, *_provenance(results), "</body></html>\n"])


def _candidate(results: Results, candidate: Candidate) -> Iterable[str]:
    """Yield the section of one policy: its metrics, and the episodes that failed."""
    run = candidate.run
    yield f"<h2>{escape(run.name)}</h2>"
    if results.baseline is None:
        summaries = ((metric, run.summary(metric.name)) for metric in results.metrics)
        rows = [(metric.name, *(quantity(value, metric.unit) for value in found)) for metric, found in summaries]
        yield _table(("metric", "mean", "least", "greatest"), rows)
    else:
        yield _table(_COMPARED, _comparisons(results, candidate), [c.verdict for c in candidate.comparisons])
    for text, names in candidate.left_out.items():
        yield f"<p>Without {escape(text)}: {escape(', '.join(names))}</p>"
    if run.failures:
        yield f"<p>{len(run.failures)} of {len(run.episodes)} episodes failed:</p><ul>"
        for episode in run.failures:
            yield f"<li>{escape(f'{episode.label}, after {episode.duration:.2f} s: {episode.failure}')}</li>"
        yield f"</ul><p>The first of them as a recording, and replayed:</p><pre>{escape(_again(results, run))}</pre>"


def _comparisons(results: Results, candidate: Candidate) -> list[tuple[str, ...]]:
    rows = []
    for seen in candidate.comparisons:
        unit = results.metric(seen.metric).unit
        values = (quantity(seen.baseline, unit), quantity(seen.candidate, unit))
        changes = (seen.share(value, unit) for value in (seen.change, seen.low, seen.high))
        rows.append((seen.metric, seen.verdict, *values, *changes, quantity(seen.tolerance, unit), seen.reasons))
    return rows


def _again(results: Results, run: PolicyRun) -> str:
    """Return the commands that run the first failure again and replay it."""
    first = run.failures[0]
    episode = ["--episode", f"{first.case}:{first.seed}"]
    record = ["python", "-m", "humanoid_sim.regress", run.source, *results.arguments, *episode]
    replay = ["python", "-m", "humanoid_sim.replay", f"runs/{recording_name(run.name, first)}"]
    return f"{shlex.join(record)}\n{shlex.join(replay)}"


def _provenance(results: Results) -> Iterable[str]:
    """Yield what was run."""
    runs = [candidate.run for candidate in results.candidates]
    if results.baseline is not None:
        runs.insert(0, results.baseline)
    yield "<h2>What was run</h2>"
    headings = ("policy", "file", "SHA-256", "episodes", "failed", "inference")
    rows = [
        (run.name, run.source, run.sha256, str(len(run.episodes)), str(len(run.failures)), run.batching) for run in runs
    ]
    yield _table(headings, rows)
    yield f"<p>{escape(', '.join(f'{name} {version}' for name, version in runs[-1].versions.items()))}</p>"


def _table(headings: Sequence[str], rows: Sequence[Sequence[str]], verdicts: Sequence[str] = ()) -> str:
    """Return a table; a row is coloured by its verdict, where there are any."""
    lines = [_row("th", headings)]
    for i, row in enumerate(rows):
        lines.append(_row("td", row, _CLASSES.get(verdicts[i], "open") if verdicts else ""))
    return "\n".join(["<table>", *lines, "</table>"])


def _row(tag: str, cells: Sequence[str], style: str = "") -> str:
    return f'<tr class="{style}">{"".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells)}</tr>'
