"""The top of the page: did it pass, and what every metric says."""

from __future__ import annotations

from humanoid_sim.regress.report.intervals import interval_bar
from humanoid_sim.regress.report.markup import badge, element, table, text
from humanoid_sim.regress.report.pairs import mean_over_cases
from humanoid_sim.regress.results import Candidate, Comparison, MetricInfo, Results
from humanoid_sim.regress.words import detectable_in_words, quantity

__all__ = ["headline", "legend", "verdict_table"]

_HEAD = ("metric", "baseline", "candidate", "change", "interval of the change", "tolerated", "detectable", "verdict")
_VALUES = ("metric", "mean over the episodes")


def headline(results: Results) -> str:
    """The verdict in one word and one sentence."""
    if results.baseline is None:
        return element("p", "No baseline was given: these are values, not verdicts.", class_="lead")
    word, kind = ("passed", "better") if results.passed else ("failed", "worse")
    lines = [element("span", word.upper(), class_=f"verdict {kind}")]
    for candidate in results.candidates:
        name = element("b", text(candidate.run.name))
        if candidate.worse:
            said = f"{name} is worse than {text(results.baseline.name)} in {text(_listed(candidate.worse))}"
        elif candidate.passed:
            said = f"{name} is not worse than {text(results.baseline.name)}"
        else:
            said = f"{name} did not pass"
        lines.append(f"{said}{_failures(candidate)}.")
    return element("p", "<br>".join(lines), class_="lead")


def _listed(names: tuple[str, ...]) -> str:
    """Such as `effort, slip and margin delay`."""
    words = [name.replace("_", " ") for name in names]
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def _failures(candidate: Candidate) -> str:
    count, total = len(candidate.run.failures), len(candidate.run.episodes)
    return f"; {count} of {total} episodes failed" if count else ""


def verdict_table(results: Results, candidate: Candidate) -> str:
    """Every metric of one candidate: means, change, interval, tolerance, and what the suite could have detected."""
    if not candidate.comparisons:
        return _value_table(results, candidate)
    detectable = {item.metric: item for item in results.detectable}
    rows = []
    for comparison in candidate.comparisons:
        metric = results.metric(comparison.metric)
        unit, found = metric.unit, detectable.get(metric.name)
        rows.append(
            [
                _name(metric),
                text(quantity(comparison.baseline, unit)),
                text(quantity(comparison.candidate, unit)),
                _change(metric, comparison),
                interval_bar(metric, comparison),
                text(quantity(comparison.tolerance, unit)),
                text(detectable_in_words(metric, found)) if found else "-",
                badge(comparison.verdict),
            ]
        )
    return table(_HEAD, rows, numbers=(1, 2, 3, 5, 6))


def _value_table(results: Results, candidate: Candidate) -> str:
    rows = []
    for metric in results.metrics:
        mean = mean_over_cases(candidate.run.episodes, metric.name)
        rows.append([_name(metric), text(quantity(mean, metric.unit))])
    return table(_VALUES, rows, numbers=(1,))


def _name(metric: MetricInfo) -> str:
    arrow = "lower is better" if metric.better == "lower" else "higher is better"
    return element("span", text(metric.name.replace("_", " ")), title=f"{metric.summary} {arrow.capitalize()}.")


def _change(metric: MetricInfo, comparison: Comparison) -> str:
    change = text(quantity(comparison.change, metric.unit, signed=True))
    if comparison.relative is None:
        return change
    return f"{change} {element('span', f'{100.0 * comparison.relative:+.1f} %', class_='faint')}"


def legend(results: Results) -> str:
    """What the columns of the tables mean; '' where nothing was compared."""
    comparisons = [comparison for candidate in results.candidates for comparison in candidate.comparisons]
    if not comparisons:
        return ""
    paired = all(comparison.paired for comparison in comparisons)
    pairing = "paired by case and seed" if paired else "compared case by case, because the seeds differ"
    power = f" with a probability of {results.detectable[0].power:.0%}" if results.detectable else ""
    return (
        "Bars: better to the left, worse to the right; the grey band is what is tolerated. All intervals hold "
        f"together with {results.confidence:.0%} confidence: {results.resamples} bootstrap resamples of the episodes, "
        f"{pairing}. Detectable: the worsening that this suite finds{power}, known from the baseline alone."
    )
