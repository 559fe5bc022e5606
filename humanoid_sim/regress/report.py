"""Findings for a person and for continuous integration: one table, as text and as HTML, and JUnit XML."""

from __future__ import annotations

import io
from xml.etree import ElementTree

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from humanoid_sim.evaluation.run_report import quantity
from humanoid_sim.regress.results import WORSE, PolicyRun, Results

_FAILURES_SHOWN = 5
_COLOURS = {WORSE: "red", "worse within tolerance": "yellow", "better": "green"}


def print_results(console: Console, results: Results) -> None:
    """Print for each policy the verdict, the table of its metrics, and the episodes that failed."""
    suite, baseline = results.suite, results.baseline
    console.print(f"{suite.name} on {results.robot}, {len(suite.cases)} cases × {suite.seeds} seeds", soft_wrap=True)
    if baseline is not None:
        console.print(
            f"baseline {baseline.name}: {len(baseline.failures)} of {len(baseline.episodes)} episodes failed",
            soft_wrap=True,
            markup=False,
        )
        made, now = baseline.versions, results.candidates[0].run.versions
        if other := [
            f"{name} {made[name]}, now {now[name]}" for name in made if now.get(name) not in (None, made[name])
        ]:
            console.print(f"note: the baseline was made with {'; '.join(other)}", soft_wrap=True, markup=False)
    for candidate in results.candidates:
        run = candidate.run
        passed = "" if baseline is None else "FAIL " if candidate.worse else "PASS "
        console.print(f"{passed}{run.name}", soft_wrap=True, markup=False)
        table = Table("metric", "verdict", "baseline", "policy", "change", "tolerated")
        for seen in candidate.comparisons:
            known = (quantity(value, seen.unit) for value in (seen.baseline, seen.candidate))
            cells = seen.metric, seen.verdict, *known, seen.text, quantity(seen.tolerance, seen.unit)
            table.add_row(*map(escape, cells), style=_COLOURS.get(seen.verdict))
        console.print(table)
        console.print(f"{len(run.failures)} of {len(run.episodes)} episodes failed", soft_wrap=True)
        for line in _failures(run)[:_FAILURES_SHOWN]:
            console.print(f"  {line}", soft_wrap=True, markup=False)


def _failures(run: PolicyRun) -> list[str]:
    return [f"{e.case}, seed {e.seed}, after {e.duration:.2f} s: {e.failure}" for e in run.failures]


def report_page(results: Results) -> str:
    """Return what is printed as a self-contained HTML page."""
    console = Console(file=io.StringIO(), width=180, highlight=False, record=True)
    print_results(console, results)
    return console.export_html()


def junit_xml(results: Results) -> bytes:
    """Return the verdicts as a JUnit XML document: a test case for each metric."""
    root = ElementTree.Element("testsuites", name=f"regress {results.suite.name}")
    for candidate in results.candidates:
        name, counts = candidate.run.name, {"tests": len(candidate.comparisons), "failures": len(candidate.worse)}
        suite = ElementTree.SubElement(root, "testsuite", {"name": name, **{key: str(n) for key, n in counts.items()}})
        for seen in candidate.comparisons:
            classname = f"{results.suite.name}.{name}"
            case = ElementTree.SubElement(suite, "testcase", name=seen.metric, classname=classname)
            if seen.verdict == WORSE:
                ElementTree.SubElement(case, "failure", message=f"{seen.verdict}: {seen.text}")
        ElementTree.SubElement(suite, "system-out").text = "\n".join(_failures(candidate.run))
    ElementTree.indent(root)
    document: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return document
