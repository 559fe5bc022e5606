"""The guide's examples run."""

import re
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis.stateful import run_state_machine_as_test

from humanoid_sim import testing

GUIDE = (Path(__file__).parents[2] / "docs" / "testing.md").read_text(encoding="utf-8")


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
