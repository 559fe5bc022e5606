"""Robustness margins: raise one disturbance at a time, level by level, until the policy fails."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from msgspec.structs import replace

from humanoid_sim.regress.arena import Arena
from humanoid_sim.regress.episodes import Disturbance
from humanoid_sim.regress.jobs import Executor, Job, Progress
from humanoid_sim.regress.metrics import METRICS
from humanoid_sim.regress.results import Episode, Margin, MarginComparison
from humanoid_sim.regress.suite import AXES, Margins, Pushes, Suite, Sweep
from humanoid_sim.regress.words import quantity
from humanoid_sim.simulation.batch import Randomisation

__all__ = ["compare_margins", "disturbance_at", "measure_margins"]

_RATE_NOISE = 10.0
"""rad/s of noise in joint and angular velocities per rad of noise in positions and orientation."""


def disturbance_at(sweep: Sweep, level: float, pushes: Pushes | None, timestep: float) -> Disturbance:
    """A robot that is as described but for one thing.

    Args:
        sweep: says for what.
        level: in the unit of the axis.
        pushes: of the suite, for their interval.
        timestep: s of physics, to a multiple of which jitter is rounded.
    """
    if sweep.axis == "push":
        return Disturbance(Randomisation(), Pushes(speed=level) if pushes is None else replace(pushes, speed=level))
    both = (level, level)
    by_axis: dict[str, dict[str, Any]] = {
        "delay": {"command_delay": both},
        "jitter": {"command_jitter": round(level / timestep) * timestep},
        "gains": {"stiffness": both, "damping": both},
        "friction": {"friction": both},
        "joint_friction": {"joint_friction": both},
        "mass": {"mass": both},
        "noise": {
            "joint_position_noise": level,
            "orientation_noise": level,
            "joint_velocity_noise": _RATE_NOISE * level,
            "angular_velocity_noise": _RATE_NOISE * level,
        },
    }
    return Disturbance(Randomisation(**by_axis[sweep.axis]))


def measure_margins(
    suite: Suite, arenas: Sequence[Arena], executor: Executor, progress: Progress
) -> tuple[Margin, ...]:
    """Every sweep of a suite, for one policy.

    Args:
        suite: has margins.
        arenas: of the policy, one per case.
        executor: runs the episodes.
        progress: told of the levels that are done.
    """
    margins = suite.margins
    assert margins is not None  # the caller has looked
    chosen = [arena for arena in arenas if not margins.cases or arena.case.name in margins.cases]
    return tuple(_sweep(suite, margins, sweep, chosen, executor, progress) for sweep in margins.sweeps)


def _sweep(
    suite: Suite, margins: Margins, sweep: Sweep, arenas: Sequence[Arena], executor: Executor, progress: Progress
) -> Margin:
    unit, nominal = AXES[sweep.axis]
    seeds = tuple(range(suite.first_seed, suite.first_seed + margins.seeds))
    limit, failure = nominal, ""
    shares: list[float] = []
    for level in sweep.levels:
        jobs = [
            Job(arena, seeds, disturbance_at(sweep, level, suite.pushes, arena.setting.physics_timestep))
            for arena in arenas
        ]
        episodes = [episode for batch in executor.run(suite, jobs, lambda _: None) for episode in batch]
        reasons = [reason for episode in episodes if (reason := _failed(suite, margins, episode))]
        shares.append(len(reasons) / len(episodes))
        if shares[-1] > margins.allowed_failures:
            failure = reasons[0]
            break
        limit = level
    progress(len(sweep.levels))
    return Margin(
        axis=sweep.name,
        unit=unit,
        nominal=nominal,
        limit=limit,
        reached_end=not failure,
        failure=failure,
        levels=sweep.levels[: len(shares)],
        failed_share=tuple(shares),
    )


def _failed(suite: Suite, margins: Margins, episode: Episode) -> str:
    """Why an episode counts as failed, '' if it does not."""
    if episode.failure:
        return f"{episode.label}: {episode.failure}"
    for name, limit in margins.limits.items():
        info, value = METRICS[suite.task][name].info, episode.metrics[name]
        if value is not None and (value > limit if info.better == "lower" else value < limit):
            shown, bound = quantity(value, info.unit), quantity(limit, info.unit)
            return f"{episode.label}: {name.replace('_', ' ')} is {shown}, accepted up to {bound}"
    return ""


def compare_margins(suite: Suite, before: Sequence[Margin], after: Sequence[Margin]) -> tuple[MarginComparison, ...]:
    """The margins that both have, in the suite's order.

    One level of the sweep more or less is within what a few seeds can tell, and counts as the same.
    """
    if suite.margins is None:
        return ()
    old, new = ({margin.axis: margin for margin in margins} for margins in (before, after))
    found = []
    for sweep in suite.margins.sweeps:
        if sweep.name in old and sweep.name in new:
            levels = [AXES[sweep.axis][1], *sweep.levels]
            baseline, candidate = old[sweep.name].limit, new[sweep.name].limit
            steps = _place(levels, candidate) - _place(levels, baseline)
            verdict = "worse" if steps < -1 else "better" if steps > 1 else "same"
            found.append(
                MarginComparison(axis=sweep.name, baseline=baseline, candidate=candidate, verdict=verdict)  # type: ignore[arg-type]
            )
    return tuple(found)


def _place(levels: Sequence[float], limit: float) -> int:
    """The level that a limit is, or is nearest to: a stored baseline's sweep may have had others."""
    return min(range(len(levels)), key=lambda i: abs(levels[i] - limit))
