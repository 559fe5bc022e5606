import json

import numpy as np
import pytest

from humanoid_sim.evaluation.run_figures import JointUse
from humanoid_sim.play.report import loop_figures, loop_rows, write_summary
from humanoid_sim.session.monitor import RunMonitor
from humanoid_sim.session.pace import DurationHistogram
from humanoid_sim.session.session import SessionResult


def result(late=(), measures=()):
    jitter = DurationHistogram()
    for seconds in late:
        jitter.add(seconds)
    return SessionResult(
        ticks=len(late) + 1,
        reason="QUIT",
        duration=2.0,
        wall_time=1.0,
        overruns=1,
        skipped=2,
        jitter=jitter,
        measures=measures,
    )


def joint_use():
    return JointUse(("hip", "knee", "foot"), np.full(3, np.inf), np.full(3, -1.0), np.ones(3))


def shown(loop):
    return "\n".join(": ".join(row) for row in loop_rows(loop, joint_use().effort()))


def test_budget_jitter_and_measures_of_a_run_in_real_time():
    monitor = RunMonitor(joint_use())
    for _ in range(100):
        monitor.tick_time.add(0.004)
    late = (*[1.5e-5] * 60, *[1.5e-4] * 3, 0.03)
    loop = loop_figures(result(late, ("memory locked",)), monitor, 0.02, realtime=True)
    assert loop["budget"] == pytest.approx(0.2, rel=0.05)
    assert (loop["overruns"], loop["skipped_deadlines"]) == (1, 2)
    assert loop["jitter"]["max"] == 0.03
    out = shown(loop)
    assert "1 missed deadlines, 2 skipped" in out
    assert "memory locked" in out
    assert "physics aside" not in out
    assert "0.0 N·m at hip; NO EFFORT LIMIT KNOWN for 3 joints" in out


def test_a_simulation_has_neither_deadlines_nor_jitter():
    loop = loop_figures(result(), RunMonitor(joint_use()), 0.005, realtime=False)
    assert loop["jitter"] is None
    assert loop["measures"] == []
    out = shown(loop)
    assert "2.0 times real time" in out
    assert "none to miss; 1 ticks took longer than the control period" in out
    assert "tick time, physics aside" in out
    assert "began late" not in out


def test_a_summary_is_json_as_the_standard_has_it(tmp_path):
    path = tmp_path / "s.json"
    write_summary(path, {"a": float("nan"), "b": [1.5, (float("inf"), 2)], "c": {"d": None, "e": True, "f": "nan"}})

    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    summary = json.loads(path.read_text(), parse_constant=refuse)
    assert summary == {"a": None, "b": [1.5, [None, 2]], "c": {"d": None, "e": True, "f": "nan"}}
