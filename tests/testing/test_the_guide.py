"""The examples of docs/testing.md run as they stand there."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis.stateful import run_state_machine_as_test

from humanoid_sim import testing
from humanoid_sim.testing import fuzz

GUIDE = (Path(__file__).parents[2] / "docs" / "testing.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```python\n(.*?)```", GUIDE, re.DOTALL)
QUICK = settings(testing.DEFAULT_SETTINGS, max_examples=2, derandomize=True, database=None)


@pytest.mark.soak
@pytest.mark.parametrize("example", EXAMPLES)
def test_an_example_runs(example, monkeypatch):
    monkeypatch.setattr(fuzz.fuzz_stack, "__defaults__", (QUICK,))
    names = {"__name__": "example"}
    exec(compile(example, "docs/testing.md", "exec"), names)
    tests = [value for name, value in names.items() if name.startswith("test_")]
    machines = [value for name, value in names.items() if name == "CarefulLite"]
    assert len(tests) + len(machines) == 1
    for test in tests:
        test()
    for machine in machines:
        run_state_machine_as_test(machine, settings=QUICK)


def test_every_public_name_is_told_or_obvious():
    for name in testing.__all__:
        assert hasattr(testing, name)
    told = {name for name in testing.__all__ if name in GUIDE}
    missing = {"SPECIAL_NUMBERS", "Misbehaviour", "ScriptedPolicy", "healthy_externs", "healthy_state"}
    assert set(testing.__all__) - told <= missing | {"moderate_numbers"}


def test_without_hypothesis_one_line_says_what_to_install():
    code = "import sys; sys.modules['hypothesis'] = None; import humanoid_sim.testing"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "humanoid_sim.testing needs the package 'hypothesis', which is not installed" in done.stderr
    assert done.stderr.rstrip().endswith("pip install 'humanoid_sim[testing]'")
