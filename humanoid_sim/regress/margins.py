"""Robustness margins: how far one disturbance at a time can be raised until the policy fails, and was that more?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from msgspec.structs import replace

from humanoid_sim.regress.executors import Advance, Executor
from humanoid_sim.regress.metrics import METRICS
from humanoid_sim.regress.preparation import PreparedCase
from humanoid_sim.regress.results import Episode, Margin, MarginComparison, quantity
from humanoid_sim.regress.suite import AXES, Disturbance, Margins, Pushes, Suite, Sweep
from humanoid_sim.simulation.batch import Randomisation

_RATE_NOISE = 10.0
"""rad/s of noise in joint and angular velocities per rad of noise in positions and orientation."""


def disturbance_at(sweep: Sweep, level: float, pushes: Pushes | None, timestep: float) -> Disturbance:
    """Return a robot that is as described but for one thing, at a level in the unit of the sweep's axis.

    Jitter is rounded to a multiple of the physics timestep, s.
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


def planned_levels(suite: Suite) -> int:
    """Return how many levels `measure_margins` counts, at most."""
    margins = suite.margins
    return 0 if margins is None else sum(len(sweep.levels) + margins.bisections for sweep in margins.sweeps)


def measure_margins(cases: Sequence[PreparedCase], executor: Executor, advance: Advance) -> tuple[Margin, ...]:
    """Every sweep of a suite that has margins, for one policy.

    The levels of a sweep are tried one after the other until the policy fails; then the stretch between the last that
    it passed and the one that it failed is halved a few times, down to what the simulation can tell apart.
    """
    suite = cases[0].suite
    margins = suite.margins
    assert margins is not None  # the caller has looked
    seeds = tuple(range(suite.first_seed, suite.first_seed + margins.seeds))
    chosen = [case for case in cases if not margins.cases or case.case.name in margins.cases]
    timestep = chosen[0].scenario.physics_timestep
    found = []
    for sweep in margins.sweeps:
        unit, nominal = AXES[sweep.axis]
        limit, fails_at, failure = nominal, math.nan, ""
        shares: dict[float, float] = {}
        levels, halvings = list(sweep.levels), margins.bisections
        while levels:
            level = levels.pop(0)
            disturbance = disturbance_at(sweep, level, suite.pushes, timestep)
            episodes = executor(chosen, seeds, disturbance, lambda _: None)
            reasons = [reason for episode in episodes if (reason := _failed(suite, margins, episode))]
            shares[level] = len(reasons) / len(episodes)
            if shares[level] > margins.allowed_failures:
                fails_at, failure, levels = level, reasons[0], []
            else:
                limit = level
            if failure and halvings:
                halvings -= 1
                middle, gap = 0.5 * (limit + fails_at), 0.0
                if unit == "s":  # delays are whole steps of physics
                    middle, gap = round(middle / timestep) * timestep, 0.5 * timestep
                levels = [middle] if min(abs(middle - limit), abs(middle - fails_at)) > gap else []
        advance(len(sweep.levels) + margins.bisections)
        tried = sorted(shares, key=lambda level: abs(level - nominal))
        found.append(
            Margin(
                axis=sweep.name,
                unit=unit,
                nominal=nominal,
                limit=limit,
                reached_end=not failure,
                failure=failure,
                levels=tuple(tried),
                failed_share=tuple(shares[level] for level in tried),
            )
        )
    return tuple(found)


def compare_margins(suite: Suite, before: Sequence[Margin], after: Sequence[Margin]) -> tuple[MarginComparison, ...]:
    """Return the margins that both have, in the suite's order.

    Of each it is known up to where the policy passed and where it failed. One is worse, or better, where these
    stretches lie further apart than is tolerated.
    """
    if suite.margins is None:
        return ()
    old, new = ({margin.axis: margin for margin in margins} for margins in (before, after))
    room = suite.margins.tolerance
    found = []
    for sweep in suite.margins.sweeps:
        if sweep.name in old and sweep.name in new:
            was, now = old[sweep.name], new[sweep.name]
            passed, passes = (abs(margin.limit - margin.nominal) for margin in (was, now))
            failed, fails = (
                math.inf if margin.fails_at is None else abs(margin.fails_at - margin.nominal) for margin in (was, now)
            )
            comparison = MarginComparison(
                axis=sweep.name, unit=now.unit, baseline=was.limit, candidate=now.limit, verdict="within tolerance"
            )
            if fails < (1.0 - room) * passed:
                comparison = replace(comparison, verdict="worse beyond tolerance")
            elif passes > (1.0 + room) * failed:
                comparison = replace(comparison, verdict="better")
            found.append(comparison)
    return tuple(found)


def _failed(suite: Suite, margins: Margins, episode: Episode) -> str:
    """Return why an episode counts as failed, '' if it does not."""
    if episode.failure:
        return f"{episode.label}: {episode.failure}"
    for name, limit in margins.limits.items():
        info, value = METRICS[suite.task][name].info, episode.metrics[name]
        if value is not None and (value > limit if info.better == "lower" else value < limit):
            shown, bound = quantity(value, info.unit), quantity(limit, info.unit)
            return f"{episode.label}: {name.replace('_', ' ')} is {shown}, accepted up to {bound}"
    return ""
