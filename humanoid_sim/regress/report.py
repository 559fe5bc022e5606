"""Findings for a person and for continuous integration: lines of text, a page of tables, and JUnit XML."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from statistics import fmean
from typing import get_args
from xml.etree import ElementTree

from humanoid_sim.regress.results import WORSE, Candidate, PolicyRun, Results, Verdict, quantity

_FAILURES_SHOWN = 5
_COLOURS = {WORSE: "#c42f3d", "worse within tolerance": "#a87800", "better": "#1e8a4f"}
_STYLE = """
body { margin: 2rem auto; padding: 0 1.5rem; max-width: 80rem; font: 15px/1.5 system-ui, sans-serif; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 0.9rem; }
th, td { padding: 0.25rem 0.6rem; text-align: left; border-bottom: 1px solid #8884; }
"""


def verdict_lines(results: Results, candidate: Candidate) -> Iterator[str]:
    """Yield the verdict on a policy and its metrics, the most urgent first; without a baseline its figures."""
    run, baseline = candidate.run, results.baseline
    if baseline is None:
        yield f"{run.name}: {len(run.episodes)} episodes, {len(run.failures)} failed; no baseline to compare with"
        yield from (f"  {metric} {figures}" for metric, figures in _figures(results, run))
    else:
        yield f"{'PASS' if candidate.passed else 'FAIL'} {run.name}"
        for verdict in get_args(Verdict):
            found = [seen for seen in candidate.comparisons if seen.verdict == verdict]
            words = [s.metric if verdict == "no difference seen" else f"{s.metric} {s.text}" for s in found]
            if words:
                yield f"  {verdict}: {', '.join(words)}"
    if run.failures:
        before = f" (the baseline: {len(baseline.failures)} of {len(baseline.episodes)})" if baseline else ""
        yield f"  {len(run.failures)} of {len(run.episodes)} episodes failed{before}:"
        yield from (f"    {line}" for line in _failures(run)[:_FAILURES_SHOWN])
        if len(run.failures) > _FAILURES_SHOWN:
            yield f"    and {len(run.failures) - _FAILURES_SHOWN} more"


def _figures(results: Results, run: PolicyRun) -> Iterator[tuple[str, str]]:
    for metric in results.suite.metrics:
        values = [value for of_case in run.values(metric.name).values() for value in of_case.values()]
        if values:
            least, mean, greatest = (quantity(f(values), metric.unit) for f in (min, fmean, max))
            yield metric.name, f"{mean} ({least} to {greatest})"


def _failures(run: PolicyRun) -> list[str]:
    return [f"{episode.label}, after {episode.duration:.2f} s: {episode.failure}" for episode in run.failures]


def report_page(results: Results) -> str:
    """Return a self-contained HTML page; the same results give the same page, to the byte."""
    suite, title = results.suite, f"Regression: {results.suite.name}"
    cases = f"{len(suite.cases)} cases × {suite.seeds} seeds, on {results.robot}"
    verdict = "PASSED" if results.passed else "FAILED"
    runs = [*([] if results.baseline is None else [results.baseline]), *(c.run for c in results.candidates)]
    lines = [
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"/><title>{escape(title)}</title>',
        f"<style>{_STYLE}</style></head><body><h1>{escape(title)}</h1>",
        f"<p>{escape(suite.summary or suite.task)}: {escape(cases)}</p>",
        f"<p>{'No baseline was given: these are values, not verdicts.' if results.baseline is None else verdict}</p>",
        "<table>",
        _row("th", ("policy", "metric", "verdict", "baseline", "candidate", "change", "episodes")),
    ]
    for candidate in results.candidates:
        if results.baseline is None:
            for metric, figures in _figures(results, candidate.run):
                lines.append(_row("td", (candidate.run.name, metric, "", "", figures, "", "")))
        for seen in candidate.comparisons:
            values = quantity(seen.baseline, seen.unit), quantity(seen.candidate, seen.unit)
            cells = (candidate.run.name, seen.metric, seen.verdict, *values, seen.text, str(seen.episodes))
            lines.append(_row("td", cells, _COLOURS.get(seen.verdict, "")))
    lines.append("</table><h2>What was run</h2>")
    for run in runs:
        lines.append(f"<p>{escape(f'{run.name}: {run.source}, SHA-256 {run.sha256}')}<br/>")
        lines.append(f"{len(run.failures)} of {len(run.episodes)} episodes failed</p>")
        lines.append(f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in _failures(run))}</ul>")
    lines.append(f"<p>{escape(', '.join(f'{name} {version}' for name, version in runs[-1].versions.items()))}</p>")
    return "\n".join([*lines, "</body></html>\n"])


def _row(tag: str, cells: Sequence[str], colour: str = "") -> str:
    style = f' style="color: {colour}"' if colour else ""
    return f"<tr{style}>{''.join(f'<{tag}>{escape(cell)}</{tag}>' for cell in cells)}</tr>"


def junit_xml(results: Results) -> bytes:
    """Return the verdicts as a JUnit XML document: a test case for each metric, skipped with nothing to compare."""
    root = ElementTree.Element("testsuites", name=f"regress {results.suite.name}")
    for candidate in results.candidates:
        name = f"{results.suite.name}: {candidate.run.name}"
        compared = {seen.metric: seen for seen in candidate.comparisons}
        suite = ElementTree.SubElement(root, "testsuite", name=name)
        for metric in results.suite.metrics:
            case = ElementTree.SubElement(
                suite, "testcase", name=metric.name, classname=f"regress.{candidate.run.name}"
            )
            seen = compared.get(metric.name)
            if seen is not None and seen.verdict == WORSE:
                message = f"{metric.name}: {seen.verdict}: {seen.text}"
                ElementTree.SubElement(case, "failure", message=message, type="regression")
            elif seen is None or seen.change is None:
                ElementTree.SubElement(case, "skipped", message="nothing to compare")
        for kind, total in (("testcase", "tests"), ("failure", "failures"), ("skipped", "skipped")):
            suite.set(total, str(len(list(suite.iter(kind)))))
        if candidate.run.failures:
            ElementTree.SubElement(suite, "system-out").text = "\n".join(_failures(candidate.run))
    ElementTree.indent(root)
    document: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return document
