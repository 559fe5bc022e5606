"""What rerun's viewer is given, written to a stand-in for the library; and what a window says."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from records import record_of

from humanoid_sim.frontends import attach
from humanoid_sim.messages import Mode
from humanoid_sim.mit import MITState
from humanoid_sim.rerun import RunLog
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import build_model
from humanoid_sim.stack import run_header
from humanoid_sim.testing.healthy import healthy_state
from humanoid_sim.viewer import window_text

LITE = load_robot("lite")


class Robot(attach.Source):
    header = run_header(LITE, 0.02, None, settings={})

    def model(self):
        return build_model(LITE)


@pytest.fixture
def written(monkeypatch):
    """By path: the newest of what was logged, as the library's types were called."""
    kinds = ("Mesh3D", "SeriesLines", "Scalars", "BarChart", "TextDocument", "Transform3D", "Quaternion")
    library = {kind: lambda *values, **named: SimpleNamespace(values=values, **named) for kind in kinds}
    monkeypatch.setitem(sys.modules, "rerun", SimpleNamespace(**library, MediaType=SimpleNamespace(MARKDOWN="")))
    found = {}
    found["stream"] = SimpleNamespace(
        log=lambda path, entity, **_: found.update({path: entity}),
        set_time=lambda _, duration: found.update(time=duration),
    )
    return found


def test_the_robot_its_plots_and_whether_it_is_the_present_are_shown(written, monkeypatch):
    monkeypatch.setattr(attach, "monotonic_ns", lambda: 5_000_000_000)
    source = Robot()
    log = RunLog(written["stream"], source)
    assert len(written["robot/left_hand"].vertex_positions) > 8
    assert written["plots/position"].names == list(LITE.joint_names)
    record = record_of(healthy_state(np.full(LITE.joint_count, 0.25), 3.0), Mode.STANDBY, "ready")
    log.tick(record)
    assert written["time"] == 3.0
    assert written["plots/position"].values[0].tolist() == [0.25] * LITE.joint_count
    raised = written["robot/left_hand"].translation.copy()
    log.tick(record_of(healthy_state(np.zeros(LITE.joint_count), 3.1)))
    assert abs(written["robot/left_hand"].translation - raised).max() > 0.05
    source.latest = attach.Tick(record, 5_000_000_000)
    log.status(source)
    assert written["status"].values[0].startswith("# STANDBY\n\nready\n\n")
    source.latest = attach.Tick(record, 3_700_000_000)
    log.status(source)
    assert written["status"].values[0].startswith("# BEHIND: this was 1.3 s ago\n")


def test_a_window_says_what_it_shows():
    known, unknown = (record_of(MITState.unknown(1, 12.34), Mode.STANDBY, "ready", qpos=q) for q in (np.zeros(1), None))
    assert window_text(known, "", "12:00:00")[2:] == ("clock\ntime\nmode\nstatus", "12:00:00\n12.3 s\nSTANDBY\nready")
    assert window_text(known, "BEHIND", "12:00:00")[3].endswith("\nBEHIND")
    assert window_text(unknown, "", "12:00:00")[3].endswith("\npose unknown")
