"""The strategies draw what they promise, and the guide's examples run."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import Phase, find, settings
from hypothesis.stateful import run_state_machine_as_test

from humanoid_sim import testing
from humanoid_sim.testing.strategies import any_states, any_tick_inputs, clock_jumps

SEARCH = settings(max_examples=2000, derandomize=True, database=None, phases=[Phase.generate], deadline=None)
GUIDE = (Path(__file__).parents[2] / "docs" / "testing.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("strategy", "wanted"),
    [
        (any_states(14, 3.0), lambda s: np.isnan(s.joint_position).all()),
        (any_states(14, 3.0), lambda s: np.isinf(s.joint_velocity).sum() == 1),
        (any_states(14, 3.0), lambda s: "anchor_pose" in s.extern),
        (clock_jumps(), lambda t: t < -1e5),
        (any_tick_inputs(14, 3.0), lambda t: t.safety and t.intents and t.remote is not None),
    ],
)
def test_what_must_be_drawn_sometimes(strategy, wanted):
    assert find(strategy, lambda value: bool(wanted(value)), settings=SEARCH) is not None


@pytest.mark.soak
@pytest.mark.parametrize("example", re.findall(r"```python\n(.*?)```", GUIDE, re.DOTALL))
def test_the_guide_s_examples_run(example, monkeypatch):
    quick = settings(testing.DEFAULT_SETTINGS, max_examples=2, derandomize=True, database=None)
    monkeypatch.setattr(testing.fuzz_stack, "__defaults__", (quick,))
    names = {"__name__": "example"}
    exec(compile(example, "docs/testing.md", "exec"), names)
    for name, value in names.items():
        if name.startswith("test_"):
            value()
    if "CarefulLite" in names:
        run_state_machine_as_test(names["CarefulLite"], settings=quick)
