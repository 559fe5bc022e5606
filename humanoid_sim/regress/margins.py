"""Robustness margins: raise one disturbance at a time, level by level, until the policy fails."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from msgspec.structs import replace

from humanoid_sim.regress.executors import Advance, Executor
from humanoid_sim.regress.metrics import METRICS
from humanoid_sim.regress.preparation import PreparedCase
from humanoid_sim.regress.results import Episode, Margin, quantity
from humanoid_sim.regress.suite import AXES, Disturbance, Margins, Pushes, Suite, Sweep
from humanoid_sim.simulation.batch import Randomisation

__all__ = ["disturbance_at", "measure_margins"]

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


def measure_margins(cases: Sequence[PreparedCase], executor: Executor, advance: Advance) -> tuple[Margin, ...]:
    """Every sweep of a suite that has margins, for one policy.

    Args:
        cases: of the policy, one per case of the suite.
        executor: runs the episodes.
        advance: told of the levels that are done.
    """
    suite = cases[0].suite
    margins = suite.margins
    assert margins is not None  # the caller has looked
    seeds = tuple(range(suite.first_seed, suite.first_seed + margins.seeds))
    chosen = [case for case in cases if not margins.cases or case.case.name in margins.cases]
    found = []
    for sweep in margins.sweeps:
        unit, nominal = AXES[sweep.axis]
        limit, failure = nominal, ""
        shares: list[float] = []
        for level in sweep.levels:
            disturbance = disturbance_at(sweep, level, suite.pushes, chosen[0].scenario.physics_timestep)
            episodes = executor.run(chosen, seeds, disturbance, lambda _: None)
            reasons = [reason for episode in episodes if (reason := _failed(suite, margins, episode))]
            shares.append(len(reasons) / len(episodes))
            if shares[-1] > margins.allowed_failures:
                failure = reasons[0]
                break
            limit = level
        advance(len(sweep.levels))
        found.append(
            Margin(
                axis=sweep.name,
                unit=unit,
                nominal=nominal,
                limit=limit,
                reached_end=not failure,
                failure=failure,
                levels=sweep.levels[: len(shares)],
                failed_share=tuple(shares),
            )
        )
    return tuple(found)


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
