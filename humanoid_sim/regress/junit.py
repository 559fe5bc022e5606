"""Verdicts as JUnit XML: a test suite per policy, a test case per metric and per robustness margin."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

from humanoid_sim.files import whole_file
from humanoid_sim.regress.results import Candidate, Results
from humanoid_sim.regress.words import change_in_words, margin_in_words

__all__ = ["junit_xml", "write_junit"]

_UNWRITABLE = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What XML 1.0 cannot hold, not even escaped."""


def write_junit(path: Path, results: Results) -> None:
    """Write the verdicts.

    Raises:
        InputError: if the file cannot be written.
    """
    with whole_file(path) as file:
        file.write(junit_xml(results))


def junit_xml(results: Results) -> bytes:
    """The XML document; a metric without a baseline to compare with, or without episodes, is a skipped case."""
    root = ElementTree.Element("testsuites", name=f"regress {_clean(results.suite.name)}")
    for candidate in results.candidates:
        root.append(_policy(results, candidate))
    for total in ("tests", "failures", "skipped"):
        root.set(total, str(sum(int(suite.get(total, "0")) for suite in root)))
    ElementTree.indent(root)
    document: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return document + b"\n"


def _policy(results: Results, candidate: Candidate) -> ElementTree.Element:
    suite = ElementTree.Element("testsuite", name=f"{_clean(results.suite.name)}: {_clean(candidate.run.name)}")
    place = f"regress.{_clean(results.suite.name)}.{_clean(candidate.run.name)}"
    by_metric = {comparison.metric: comparison for comparison in candidate.comparisons}
    for metric in results.metrics:
        case = ElementTree.SubElement(suite, "testcase", name=metric.name, classname=place)
        comparison = by_metric.get(metric.name)
        if comparison is not None and comparison.is_lost:
            message = f"{metric.name} is lost: no episode got to its end"
            ElementTree.SubElement(case, "failure", message=message, type="regression")
            continue
        if comparison is None or comparison.verdict == "unmeasured":
            reason = "no baseline" if comparison is None else "no episodes to compare"
            ElementTree.SubElement(case, "skipped", message=reason)
            continue
        words = _clean(change_in_words(metric, comparison))
        if comparison.verdict == "worse":
            ElementTree.SubElement(case, "failure", message=f"{metric.name} is worse: {words}", type="regression")
        ElementTree.SubElement(case, "system-out").text = f"{comparison.verdict}: {words}"
    for margin in candidate.margins:
        case = ElementTree.SubElement(suite, "testcase", name=f"margin {margin.axis}", classname=place)
        if margin.verdict == "worse":
            message = f"margin {margin.axis} is worse: {margin_in_words(margin)}"
            ElementTree.SubElement(case, "failure", message=message, type="regression")
    suite.set("tests", str(len(suite)))
    for kind, total in (("failure", "failures"), ("skipped", "skipped")):
        suite.set(total, str(sum(case.find(kind) is not None for case in suite)))
    lines = [f"{episode.label}: {episode.failure}" for episode in candidate.run.failures]
    if lines:
        ElementTree.SubElement(suite, "system-out").text = _clean("failed episodes:\n" + "\n".join(lines))
    return suite


def _clean(text: str) -> str:
    return _UNWRITABLE.sub("?", text)
