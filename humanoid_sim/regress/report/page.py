"""Report of a run: the template `page.html`, filled in. Verdicts come first, then what they come from."""

from __future__ import annotations

import base64
import io
import math
import shlex
from collections.abc import Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from PIL import Image

from humanoid_sim.regress.episodes import Step, run_episodes
from humanoid_sim.regress.preparation import PreparedSuite, TestedPolicy
from humanoid_sim.regress.recordings import recording_name
from humanoid_sim.regress.report import plots
from humanoid_sim.regress.report.pairs import Pair, mean_over_cases, pair_up, trace, worst
from humanoid_sim.regress.results import Candidate, Comparison, Episode, MetricInfo, PolicyRun, Results, quantity
from humanoid_sim.rendering.offscreen import PoseRenderer
from humanoid_sim.simulation.model import build_model

_SIZE = (480, 400)
"""Pixels of a picture: the software painter draws it, with neither a display nor OpenGL."""
_WORST = 10
_POWERS = 6
"""Powers of ten: no bar reaches further."""


def report_page(results: Results, pictures: Sequence[Sequence[Picture]] = ()) -> str:
    """Return the page, as HTML."""
    environment = Environment(
        loader=PackageLoader("humanoid_sim.regress.report", "."),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters |= {"quantity": quantity, "listed": _listed}
    comparisons = [comparison for candidate in results.candidates for comparison in candidate.comparisons]
    paired = results.baseline is not None and all(comparison.paired for comparison in comparisons)
    moved = plots.moved_metrics(results)
    with mpl.rc_context(plots.SETTINGS):
        drawn = {
            "cases": plots.case_plot(results, moved, paired=paired, name="cases-plot") if moved else "",
            "candidates": [
                {**_candidate(results, i, candidate), "pictures": pictures[i] if pictures else ()}
                for i, candidate in enumerate(results.candidates)
            ],
            "margins": plots.margin_plot(results, "margins-plot"),
        }
    return environment.get_template("page.html").render(
        **drawn,
        results=results,
        colours=plots.COLOURS,
        paired=paired,
        old_margins={margin.axis: margin for margin in results.baseline.margins} if results.baseline else {},
        mean=mean_over_cases,
        runs=[
            *([("baseline", results.baseline)] if results.baseline else []),
            *(("candidate", candidate.run) for candidate in results.candidates),
        ],
    )


def _candidate(results: Results, index: int, candidate: Candidate) -> dict[str, Any]:
    """Return what the page shows of one candidate beside what it holds itself."""
    first = worst(pair_up(candidate.run, results.baseline), results.metrics[0], _WORST)
    known = [(results.metric(comparison.metric), comparison) for comparison in candidate.comparisons]
    announced = {item.metric: item.change for item in results.detectable}
    end = scale_end(candidate.comparisons)
    return {
        "run": candidate.run,
        "word": "passed" if candidate.passed else "undecided" if candidate.undecided else "failed",
        "verdicts": results.verdicts(candidate),
        "unclear": candidate.unclear,
        "undecided": candidate.undecided,
        "few_seeds": candidate.few_seeds,
        "rows": [
            (metric, comparison, interval_bar(metric, comparison, end), announced.get(metric.name))
            for metric, comparison in known
        ],
        "end": end,
        "tolerated": _place(1.0, end),
        "left_out": list(candidate.left_out.items()),
        "worst": first,
        "again": _again(results, candidate, first[0]) if first else "",
        "traces": plots.trace_plot(results, first[0], plots.candidate_colour(index), f"traces-{index}-plot")
        if first
        else "",
        "margin_verdicts": {comparison.axis: comparison.verdict for comparison in candidate.margins},
    }


def _again(results: Results, candidate: Candidate, pair: Pair) -> str:
    """Return the commands that run an episode again, record it, and play its policy on."""
    episode = pair.candidate
    record = ["python", "-m", "humanoid_sim.regress", candidate.run.source, *results.arguments]
    file = f"runs/{recording_name(candidate.run.name, episode)}"
    commands = [
        [*record, "--episode", f"{episode.case}:{episode.seed}"],
        ["python", "-m", "humanoid_sim.replay", file],
        ["python", "-m", "humanoid_sim.play", "--again", file],
    ]
    return "\n".join(shlex.join(command) for command in commands)


class IntervalBar(NamedTuple):
    """Position of the change of a metric and its interval on a bar from -100 to 100, worse to the right."""

    left: float
    change: float
    right: float


def scale_end(comparisons: Sequence[Comparison]) -> float:
    """Tolerances at the ends of a candidate's bars: 3, 10, 30, 100, … so that its largest change is on them."""
    reach = [
        max(abs(c.low), abs(c.high)) / c.tolerance
        for c in comparisons
        if c.low is not None and c.high is not None and c.tolerance
    ]
    ends = (factor * 10.0**power for power in range(_POWERS) for factor in (3.0, 10.0))
    return next((end for end in ends if end >= max(reach, default=0.0)), 10.0**_POWERS)


def _place(tolerances: float, end: float) -> float:
    """Return where so many tolerances lie on a bar: about even within them, and logarithmic beyond."""
    return math.copysign(100.0 * math.log2(1.0 + min(abs(tolerances), end)) / math.log2(1.0 + end), tolerances)


def interval_bar(metric: MetricInfo, comparison: Comparison, end: float) -> IntervalBar | None:
    """Return the bar on its candidate's scale; None without a change."""
    values, tolerance = (comparison.low, comparison.change, comparison.high), comparison.tolerance
    if None in values or tolerance is None:
        return None
    sign = 1.0 if metric.better == "lower" else -1.0
    low, change, high = (
        _place(sign * value / tolerance if tolerance else math.copysign(math.inf, sign * value), end) if value else 0.0
        for value in values
    )
    return IntervalBar(min(low, high), change, max(low, high))


def _listed(names: Sequence[str]) -> str:
    """Such as `effort, slip and margin delay`."""
    readable = [name.replace("_", " ") for name in names]
    return " and ".join([", ".join(readable[:-1]), readable[-1]] if len(readable) > 1 else readable)


class Picture(NamedTuple):
    """A robot at one moment of an episode."""

    title: str
    address: str
    """The picture itself, as what an `img` element takes for a file's address."""


def worst_pictures(
    prepared: PreparedSuite,
    policies: Sequence[TestedPolicy],
    baseline: TestedPolicy | PolicyRun | None,
    results: Results,
) -> list[list[Picture]]:
    """For each candidate its worst episode at its worst moment; and the baseline then, where it is a checkpoint."""
    model = build_model(prepared.description)
    painter = PoseRenderer(lambda: model, *_SIZE, fastest=True)
    found = []
    for policy, candidate in zip(policies, results.candidates, strict=True):
        (pair,) = worst(pair_up(candidate.run, results.baseline), results.metrics[0], 1)
        moment = worst_moment(pair.candidate, results.metrics[0], results.suite.policy_dt)
        pictures = []
        for shown in (baseline, policy):
            if isinstance(shown, TestedPolicy):
                case = next(case for case in shown.cases if case.case.name == pair.candidate.case)
                steps: list[Step] = []
                run_episodes(case, [pair.candidate.seed], prepared.suite.disturbance, threads=1, watch=steps)
                step = min(moment, len(steps) - 1)
                file = io.BytesIO()
                Image.fromarray(painter.draw(steps[step].qpos[0])).save(file, "PNG")
                time = step * case.scenario.contract.policy_dt
                address = f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}"
                pictures.append(Picture(f"{shown.name} at {time:.2f} s", address))
        found.append(pictures)
    painter.close()
    return found


def worst_moment(episode: Episode, metric: MetricInfo, policy_dt: float) -> int:
    """Return the policy step to look at: the last of an episode that failed, else where a metric's trace is worst."""
    if episode.failure or metric.name not in episode.traces:
        return episode.steps
    values = trace(episode, metric.name) * (1.0 if metric.better == "lower" else -1.0)
    known = np.where(np.isfinite(values), values, -np.inf)
    return round(episode.trace_times[int(known.argmax())] / policy_dt)
