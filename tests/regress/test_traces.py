"""Traces short enough to be kept."""

from __future__ import annotations

import numpy as np

from humanoid_sim.regress.traces import LONGEST, thinned


def test_a_short_episode_keeps_every_step() -> None:
    times, traces = thinned({"effort": np.array([1.0, 2.0, 4.0])}, 0.02)
    assert times == (0.02, 0.04, 0.06)
    assert traces == {"effort": (1.0, 2.0, 4.0)}


def test_a_long_one_keeps_means_of_stretches() -> None:
    values = np.arange(4 * LONGEST, dtype=np.float64)
    times, traces = thinned({"effort": values}, 0.01)
    assert len(times) == LONGEST
    assert traces["effort"][:2] == (1.5, 5.5)
    assert times[:2] == (0.025, 0.065)


def test_steps_without_a_value_do_not_count() -> None:
    nan = np.nan
    values = np.tile([nan, 3.0], LONGEST)
    values[:2] = nan
    _, traces = thinned({"slip": values, "nothing": np.full(2 * LONGEST, nan)}, 0.01)
    assert traces["slip"][:2] == (None, 3.0)
    assert "nothing" not in traces


def test_nothing_was_run() -> None:
    assert thinned({"effort": np.empty(0)}, 0.02) == ((), {})
