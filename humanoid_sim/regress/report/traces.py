"""What differs over time: the traces of the episodes that moved most."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from humanoid_sim.regress.report.drawing import axis_label, drawing, style_axes
from humanoid_sim.regress.report.markup import element, text
from humanoid_sim.regress.report.pairs import Pair, by_case, pair_up, trace, trace_difference, worst
from humanoid_sim.regress.report.palette import COLOURS, candidate_colour
from humanoid_sim.regress.results import Candidate, Episode, Results
from humanoid_sim.regress.words import displayed_unit

__all__ = ["trace_plots"]

_EPISODES = 4
_TRACES = 3


def trace_plots(results: Results, index: int) -> str:
    """HTML: for each of a few episodes its traces beside the baseline's, or a line that says that none differs.

    Args:
        results: of the run.
        index: of the candidate.
    """
    candidate = results.candidates[index]
    chosen = _episodes(results, candidate)
    if not any(pair.candidate.traces for pair in chosen):
        return element("p", "The results hold no traces.", class_="note")
    names = _names(results, chosen)
    if not names:
        return element("p", "No trace differs from the baseline's: they are equal to the last bit.", class_="note")
    parts = []
    for i, pair in enumerate(chosen):
        name = f"traces-{index}-{i}"
        caption = _caption(pair)
        svg = _plot(results, pair, names, candidate_colour(index), name)
        parts.append(element("figure", f"{element('figcaption', caption)}\n{svg}"))
    return "\n".join([*parts, element("p", text(_legend(results)), class_="note")])


def _episodes(results: Results, candidate: Candidate) -> tuple[Pair, ...]:
    """Failures that are new, then the episodes whose traces differ most from the baseline's: one of each case first."""
    pairs = pair_up(candidate.run, results.baseline)
    if not any(pair.baseline for pair in pairs):
        return worst(pairs, results.metrics[0], _EPISODES)
    failed = [pair for pair in pairs if pair.candidate.failure and not (pair.baseline and pair.baseline.failure)]
    scales = {name: _scale(results, name) for name in _trace_names(pairs)}
    rest = sorted(
        (pair for pair in pairs if pair not in failed),
        key=lambda pair: -max((trace_difference(pair, name) / scales[name] for name in scales), default=0.0),
    )
    ranked = [*failed[: _EPISODES // 2], *rest]
    of_each_case = list({pair.candidate.case: pair for pair in reversed(ranked)}.values())[::-1]
    of_each_case.sort(key=ranked.index)
    return tuple([*of_each_case, *(pair for pair in ranked if pair not in of_each_case)][:_EPISODES])


def _trace_names(pairs: Sequence[Pair]) -> list[str]:
    return list(dict.fromkeys(name for pair in pairs for name in pair.candidate.traces))


def _scale(results: Results, name: str) -> float:
    """What is usual for a trace: its root mean square over the baseline's episodes."""
    episodes = results.baseline.episodes if results.baseline else ()
    values = np.concatenate([trace(e, name) for e in episodes if name in e.traces] or [np.ones(1)])
    square = float(np.nanmean(values * values)) if np.isfinite(values).any() else 1.0
    return float(np.sqrt(square)) or 1.0


def _names(results: Results, chosen: Sequence[Pair]) -> list[str]:
    """The traces that differ most over the chosen episodes; without a baseline, the first."""
    names = _trace_names(chosen)
    if not any(pair.baseline for pair in chosen):
        return names[:_TRACES]
    size = {name: max(trace_difference(pair, name) for pair in chosen) / _scale(results, name) for name in names}
    differing = [name for name in names if size[name] > 0.0]
    keep = set(sorted(differing, key=lambda name: -size[name])[:_TRACES])
    return [name for name in names if name in keep]


def _caption(pair: Pair) -> str:
    said = element("b", text(pair.candidate.label))
    if pair.candidate.failure:
        said += f": {text(pair.candidate.failure)}, after {pair.candidate.duration:.2f} s"
    if pair.baseline is not None and pair.baseline.failure:
        said += f" (the baseline: {text(pair.baseline.failure)}, after {pair.baseline.duration:.2f} s)"
    return said


def _plot(results: Results, pair: Pair, names: Sequence[str], colour: str, name: str) -> str:
    others = by_case(results.baseline.episodes if results.baseline else ()).get(pair.candidate.case, ())
    with drawing(2.1, name, f"traces of {pair.candidate.label}") as sheet:
        row = sheet.figure.subplots(1, len(names), squeeze=False, sharex=True)[0]
        for axes, trace_name in zip(row, names, strict=True):
            _draw(axes, results, pair, others, trace_name, colour)
    return sheet.svg


def _draw(axes: Axes, results: Results, pair: Pair, others: Sequence[Episode], name: str, colour: str) -> None:
    units = {metric.name: metric.unit for metric in results.metrics}
    factor, _ = displayed_unit(units.get(name, ""))
    _draw_range(axes, others, name, factor)
    for episode, line in ((pair.baseline, COLOURS["baseline"]), (pair.candidate, colour)):
        if episode is None or name not in episode.traces:
            continue
        values = factor * trace(episode, name)
        axes.plot(episode.trace_times, values, color=line)
        if episode.failure and np.isfinite(values).any():
            last = int(np.flatnonzero(np.isfinite(values))[-1])
            axes.plot(episode.trace_times[last], values[last], marker="X", markersize=7, color=line)
    axes.set_title(axis_label(name, units[name]) if name in units else name.replace("_", " "))
    axes.set_xlabel("time [s]")
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    style_axes(axes)


def _draw_range(axes: Axes, episodes: Sequence[Episode], name: str, factor: float) -> None:
    """Between the least and the greatest of the baseline's episodes of the same case, at each time."""
    known = [e for e in episodes if name in e.traces and len(e.trace_times) > 1]
    if not known:
        return
    longest = max(known, key=lambda e: e.trace_times[-1])
    times = np.array(longest.trace_times)
    rows = [np.interp(times, e.trace_times, factor * trace(e, name), right=np.nan) for e in known]
    stacked = np.ma.masked_invalid(np.stack(rows))
    low, high = stacked.min(axis=0), stacked.max(axis=0)
    axes.fill_between(
        times, low.filled(np.nan), high.filled(np.nan), color=COLOURS["baseline"], alpha=0.16, linewidth=0
    )


def _legend(results: Results) -> str:
    if results.baseline is None:
        return "A cross marks the step in which an episode failed."
    return (
        f"Grey: {results.baseline.name}, and as a band the range of all its episodes of the same case; coloured: the "
        "candidate. A cross marks the step in which an episode failed."
    )
