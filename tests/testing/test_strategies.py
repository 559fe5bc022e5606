"""The strategies draw what they promise, and the guide's examples run."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, find, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import run_state_machine_as_test

from humanoid_sim import testing
from humanoid_sim.controllers.parameters import command_problem
from humanoid_sim.messages import Intent, SafetyLevel
from humanoid_sim.testing import fuzz

SEARCH = settings(max_examples=2000, derandomize=True, database=None, phases=[Phase.generate], deadline=None)
FEW = settings(max_examples=15, suppress_health_check=[HealthCheck.too_slow])
GUIDE = (Path(__file__).parents[2] / "docs" / "testing.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("strategy", "wanted"),
    [
        (testing.any_numbers(), np.isnan),
        (testing.any_numbers(), lambda x: 0.0 < abs(x) < 1e-307),
        (testing.any_arrays(14), lambda a: np.isinf(a).sum() == 1),
        (testing.any_arrays(14), lambda a: np.isnan(a).sum() > 2 and np.isfinite(a).any()),
        (testing.any_externs(), lambda e: "anchor_pose" in e and e["anchor_pose"].value.shape != (7,)),
        (testing.any_states(14, 3.0), lambda s: np.isnan(s.joint_position).all()),
        (testing.any_states(14, 3.0), lambda s: not s.imu_quaternion.any()),
        (testing.safety_statuses(), lambda some: {s.level for s in some} == {SafetyLevel.OK, SafetyLevel.CRITICAL}),
        (testing.safety_statuses(), lambda some: any(s.flags >= 64 for s in some)),
        (testing.intents(), lambda some: len(some) == 3 and some[0] is not Intent.DAMP and Intent.DAMP in some),
        (testing.clock_jumps(), lambda t: t < -1e5),
        (testing.any_commands(14), lambda c: (c.stiffness < 0).any()),
        (testing.any_remote_commands(14, 3.0), lambda r: r.command.joint_count == 15),
        (testing.any_tick_inputs(14, 3.0), lambda t: t.safety and t.intents and t.remote is not None),
    ],
)
def test_what_must_be_drawn_sometimes(strategy, wanted):
    assert find(strategy, lambda value: bool(wanted(value)), settings=SEARCH) is not None


@FEW
@given(st.data(), st.sampled_from([1, 14, 29]), st.floats(-10, 10))
def test_what_a_working_robot_or_sender_gives_is_sound(data, n, time):
    state = data.draw(testing.healthy_states(n, time))
    assert (state.joint_count, state.time) == (n, time)
    for array in (state.joint_position, state.joint_velocity, state.joint_effort):
        assert (np.abs(array) <= 3.0).all()
    assert command_problem(data.draw(testing.valid_commands(n)), tuple(map(str, range(n)))) == ""


@pytest.mark.soak
@pytest.mark.parametrize("example", re.findall(r"```python\n(.*?)```", GUIDE, re.DOTALL))
def test_the_guide_s_examples_run(example, monkeypatch):
    quick = settings(testing.DEFAULT_SETTINGS, max_examples=2, derandomize=True, database=None)
    monkeypatch.setattr(fuzz.fuzz_stack, "__defaults__", (quick,))
    names = {"__name__": "example"}
    exec(compile(example, "docs/testing.md", "exec"), names)
    tests = [value for name, value in names.items() if name.startswith("test_")]
    machines = [names["CarefulLite"]] if "CarefulLite" in names else []
    assert len(tests) + len(machines) >= 1
    for test in tests:
        test()
    for machine in machines:
        run_state_machine_as_test(machine, settings=quick)


def test_without_hypothesis_one_line_says_what_to_install():
    code = "import sys; sys.modules['hypothesis'] = None; import humanoid_sim.testing"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.rstrip().endswith("pip install 'humanoid_sim[testing]'")
