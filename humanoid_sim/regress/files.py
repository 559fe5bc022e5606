"""Results on disk: baselines and everything that was found as JSON, verdicts as JUnit XML."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import msgspec

from humanoid_sim.errors import InputError, blaming, known_names, reason_of
from humanoid_sim.evaluation.failure import differing
from humanoid_sim.files import regular_file
from humanoid_sim.regress.metrics import has_metric
from humanoid_sim.regress.options import RegressConfig
from humanoid_sim.regress.preparation import PreparedSuite
from humanoid_sim.regress.results import FAILING, OPEN, Candidate, PolicyRun, Results, describe_change

_UNWRITABLE = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold, not even escaped."""


def json_of(value: msgspec.Struct) -> bytes:
    """Return a result as JSON, indented, such that a difference of two files can be read."""
    return msgspec.json.format(msgspec.json.encode(value), indent=1) + b"\n"


def read_baseline(path: Path) -> PolicyRun:
    """Return a stored run. Raises `InputError`: one line with the file and what is wrong with it."""
    with blaming(f"{path}: cannot be read", OSError):
        data = regular_file(path, "a baseline (.json) or a checkpoint (.onnx)").read_bytes()
    try:
        run = msgspec.json.decode(data, type=PolicyRun)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        if b'"candidates"' in data and b'"suite"' in data:  # taken for a baseline more often than anything else
            raise InputError(f"{path}: is a result of --json, expected a baseline of --write-baseline") from None
        raise InputError(f"{path}: is not a baseline of `regress --write-baseline`: {reason_of(error)}") from None
    if not run.episodes:
        raise InputError(f"{path}: holds no episodes, expected a baseline of `regress --write-baseline`")
    return run


def matching_baseline(prepared: PreparedSuite, baseline: PolicyRun, config: RegressConfig) -> PolicyRun:
    """Return the part of a stored baseline that a suite's cases are compared with.

    Raises `InputError` if a case is not in it, or was another when the baseline was made, its figures mean something
    else, or it lacks a metric that the suite judges.
    """
    source, digests, suite = config.baseline, prepared.digests, prepared.suite
    again = f"make it again: {_remake(baseline, config)}"
    others = differing(baseline.definitions)
    if others:
        raise InputError(
            f"{source}: was made with other definitions than today's ({', '.join(others)}), so its figures cannot be "
            f"compared; {again}"
        )
    for name, digest in digests.items():
        if name not in baseline.case_digests:
            raise InputError(f"{source}: {known_names('case', name, baseline.case_digests)}")
        if baseline.case_digests[name] != digest:
            raise InputError(
                f"{source}: its case '{name}' was run under other conditions (suite, motion or robot have changed "
                f"since); {again}"
            )
    kept = tuple(episode for episode in baseline.episodes if episode.case in digests)
    known = {(episode.case, metric) for episode in kept for metric in episode.metrics}
    lacking = [
        metric.name
        for metric in suite.metrics
        if any(has_metric(metric.name, case.command) and (case.name, metric.name) not in known for case in suite.cases)
    ]
    if lacking:
        named = ", ".join(lacking)
        raise InputError(f"{source}: was made before {named} could be measured, which the suite judges; {again}")
    return msgspec.structs.replace(baseline, episodes=kept, case_digests=digests)


def _remake(baseline: PolicyRun, config: RegressConfig) -> str:
    """Return the command that makes a stored baseline again, under today's conditions and definitions."""
    command = ["python", "-m", "humanoid_sim.regress", baseline.source, "--suite", config.suite]
    for option in ("robot", "contract", "seeds", "first_seed"):
        value = getattr(config, option)
        if value is not None:
            command += [f"--{option.replace('_', '-')}", str(value)]
    return shlex.join([*command, "--write-baseline", str(config.baseline), "--overwrite"])


def junit_xml(results: Results, seconds: Sequence[float] = ()) -> bytes:
    """Return the verdicts as a JUnit XML document.

    A metric without a baseline to compare with, or without episodes, is a skipped case. The `seconds` that a candidate
    took are shared equally by its cases, as every verdict is of all its episodes.
    """
    root = ElementTree.Element("testsuites", name=_clean(f"regress {results.suite.name}"))
    for i, candidate in enumerate(results.candidates):
        root.append(_policy(results, candidate, seconds[i] if seconds else None))
    for total in ("tests", "failures", "skipped"):
        root.set(total, str(sum(int(suite.get(total, "0")) for suite in root)))
    if seconds:
        root.set("time", f"{sum(seconds):.3f}")
    ElementTree.indent(root)
    document: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return document + b"\n"


def _policy(results: Results, candidate: Candidate, seconds: float | None) -> ElementTree.Element:
    name = _clean(candidate.run.name)
    suite = ElementTree.Element("testsuite", name=f"{_clean(results.suite.name)}: {name}")
    place = f"regress.{_clean(results.suite.name)}.{name}"
    by_metric = {comparison.metric: comparison for comparison in candidate.comparisons}
    verdicts: list[tuple[str, str, str]] = []
    for metric in results.metrics:
        comparison = by_metric.get(metric.name)
        if comparison is None:
            verdict, words = "skipped", "no baseline"
        elif comparison.verdict == "lost":
            verdict, words = "lost", "no episode got to its end"
        elif comparison.verdict == "unmeasured":
            verdict, words = "skipped", "no episodes to compare"
        else:
            verdict, words = comparison.verdict, describe_change(metric, comparison)
        verdicts.append((metric.name, verdict, words))
    for title, verdict, words in verdicts:
        case = ElementTree.SubElement(suite, "testcase", name=title, classname=place)
        if verdict == "skipped":
            ElementTree.SubElement(case, "skipped", message=words)
            continue
        if verdict in FAILING or ((results.strict or candidate.undecided) and verdict in OPEN):
            message = _clean(f"{title}: {verdict}: {words}")
            ElementTree.SubElement(case, "failure", message=message, type="regression")
        ElementTree.SubElement(case, "system-out").text = _clean(f"{verdict}: {words}")
    suite.set("tests", str(len(suite)))
    for kind, total in (("failure", "failures"), ("skipped", "skipped")):
        suite.set(total, str(sum(case.find(kind) is not None for case in suite)))
    if seconds is not None:
        suite.set("time", f"{seconds:.3f}")
        for case in suite:
            case.set("time", f"{seconds / len(suite):.3f}")
    lines = [f"{episode.label}: {episode.failure}" for episode in candidate.run.failures]
    if lines:
        ElementTree.SubElement(suite, "system-out").text = _clean("failed episodes:\n" + "\n".join(lines))
    return suite


def _clean(text: str) -> str:
    return _UNWRITABLE.sub("?", text)
