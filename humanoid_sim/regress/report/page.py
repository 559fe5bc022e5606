"""The page as a whole: verdicts first, then what they come from."""

from __future__ import annotations

from humanoid_sim.regress.report.distributions import distribution_plot, varies
from humanoid_sim.regress.report.episodes import episode_map, worst_table
from humanoid_sim.regress.report.margins import margin_plot, margin_table
from humanoid_sim.regress.report.markup import element, section, table, text
from humanoid_sim.regress.report.stylesheet import stylesheet
from humanoid_sim.regress.report.traces import trace_plots
from humanoid_sim.regress.report.verdicts import headline, legend, verdict_table
from humanoid_sim.regress.results import MetricInfo, PolicyRun, Results

__all__ = ["assemble"]


def assemble(results: Results) -> str:
    """The HTML of the page."""
    title = f"Regression: {results.suite.name}"
    body = "\n".join(
        [
            _top(results),
            *_verdicts(results),
            _distributions(results),
            *_episodes(results),
            _margins(results),
            _provenance(results),
        ]
    )
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{text(title)}</title>\n<style>\n{stylesheet()}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def _top(results: Results) -> str:
    suite = results.suite
    size = f"{len(suite.cases)} cases × {len(suite.seeds)} seeds, {suite.duration:g} s at most, on {suite.robot}"
    said = f"{suite.summary[:1].upper()}{suite.summary[1:]}" if suite.summary else suite.task.capitalize()
    lead = element("p", text(f"{said}: {size}."), class_="note")
    return element("header", f"{element('h1', text(f'Regression: {suite.name}'))}\n{lead}\n{headline(results)}")


def _verdicts(results: Results) -> list[str]:
    return [
        section(candidate.run.name, verdict_table(results, candidate), name=f"verdict-{i}")
        for i, candidate in enumerate(results.candidates)
    ] + [element("p", text(legend(results)), class_="note")]


def _distributions(results: Results) -> str:
    """The metrics that moved, worst first; the others one click away."""
    plotted = [metric for metric in results.metrics if varies(results, metric)]
    constant = [metric for metric in results.metrics if metric not in plotted]
    moved = sorted(
        (metric for metric in plotted if _interest(results, metric) < _SAME), key=lambda m: _interest(results, m)
    )
    if not moved:
        moved = plotted[:1]
    rest = [metric for metric in plotted if metric not in moved]
    parts = [_distribution(results, metric) for metric in moved]
    if rest:
        inner = "\n".join(_distribution(results, metric) for metric in rest)
        names = ", ".join(metric.name.replace("_", " ") for metric in rest)
        parts.append(element("details", f"{element('summary', text(f'Not moved: {names}'))}\n{inner}"))
    if constant:
        names = ", ".join(metric.name.replace("_", " ") for metric in constant)
        parts.append(element("p", text(f"The same in every episode of every policy: {names}."), class_="note"))
    return section("Distributions", *parts, element("p", text(_DOTS), class_="note"), name="distributions")


_DOTS = (
    "A dot is an episode, a dashed line the mean. By case, the upright mark is the mean, and the shaded side is worse "
    "than is tolerated. An episode that failed has no errors to compare: it counts among the losses, falls and faults."
)


_VERDICTS = ("worse", "unclear", "better", "same", "unmeasured")
_SAME = _VERDICTS.index("same")


def _interest(results: Results, metric: MetricInfo) -> int:
    """The most interesting verdict that any candidate has for the metric; without a baseline all are equal."""
    found = [
        _VERDICTS.index(comparison.verdict)
        for candidate in results.candidates
        for comparison in candidate.comparisons
        if comparison.metric == metric.name
    ]
    return min(found, default=0)


def _distribution(results: Results, metric: MetricInfo) -> str:
    caption = f"{element('b', text(metric.name.replace('_', ' ')))}: {text(metric.summary)}"
    svg = distribution_plot(results, metric, f"metric-{metric.name}")
    return element("figure", f"{element('figcaption', caption)}\n{svg}")


def _episodes(results: Results) -> list[str]:
    several = len(results.candidates) > 1
    parts = []
    for i, candidate in enumerate(results.candidates):
        of = f" of {candidate.run.name}" if several else ""
        overview = episode_map(results, candidate, f"map-{i}")
        figure = element("figure", overview) if overview else ""
        parts.append(section(f"Worst episodes{of}", figure, worst_table(results, candidate), name=f"worst-{i}"))
        title = f"Traces{of} that differ" if results.baseline else f"Traces{of}"
        parts.append(section(title, trace_plots(results, i), name=f"traces-{i}"))
    return parts


def _margins(results: Results) -> str:
    plot = margin_plot(results, "margins-plot")
    if not plot:
        return ""
    tables = []
    for candidate in results.candidates:
        if candidate.run.margins:
            tables += [element("h3", text(candidate.run.name)), margin_table(candidate, results)]
    note = element("p", "A dashed line is the margin: up to it, every level passed.", class_="note")
    return section("Margins", element("figure", plot), note, *tables, name="margins")


def _provenance(results: Results) -> str:
    runs = [("candidate", candidate.run) for candidate in results.candidates]
    if results.baseline is not None:
        runs.insert(0, ("baseline", results.baseline))
    rows = [_run_row(role, run) for role, run in runs]
    versions = "; ".join(f"{name} {version}" for name, version in runs[-1][1].versions.items())
    lines = [
        table(("", "policy", "file", "SHA-256", "episodes", "failed", "inference"), rows, numbers=(4, 5)),
        element("p", text(f"{versions}."), class_="note") if versions else "",
    ]
    return section("What was run", *lines, name="provenance")


def _run_row(role: str, run: PolicyRun) -> list[str]:
    return [
        text(role),
        text(run.name),
        element("code", text(run.source)),
        element("code", text(run.sha256[:12])),
        text(len(run.episodes)),
        text(len(run.failures)),
        text(run.batching or "-"),
    ]
