"""What the page shows of a robot, without a browser."""

import tempfile
from pathlib import Path

import numpy as np

from humanoid_sim.client import monotonic_ns
from humanoid_sim.frontends.attach import Source, Tick
from humanoid_sim.frontends.console.panel import Panel
from humanoid_sim.frontends.console.scene import Scene
from humanoid_sim.messages import ControlMode, Mode, SafetyLevel, SafetyStatus, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import build_model
from humanoid_sim.stack import run_header
from humanoid_sim.testing import healthy_state

LITE = load_robot("lite")


class Motors(Source):
    """A robot on a bus, watched only."""

    is_hardware = True
    header = run_header(LITE, 0.02, None, settings={})

    def model(self):
        return build_model(LITE)

    def status(self):
        robot = {"temperature": {"left_elbow_pitch": 61.0}, "faults": {"left_elbow_pitch": ["too hot"]}}
        return {"robot": robot, "owners": {"REMOTE": "gravity (7)"}, "recording": {"file": "r.mcap", "error": None}}


def test_a_watched_robot_s_modes_joints_motors_and_safety_are_shown():
    source, status = Motors(), SafetyStatus(SafetyLevel.FAULT, source="can0", message="<down>")
    output = TickOutput(MITCommand.zeros(LITE.joint_count), ControlMode(Mode.DAMPING, "damping_controller", "DAMP"))
    state = healthy_state(np.full(LITE.joint_count, 0.25), 3.0)
    with tempfile.TemporaryDirectory(prefix="hs-") as folder:
        scene = Scene(Path(folder) / "viser", source)
        panel = Panel(source, scene, None)
        assert panel.show() == {"age": 0.0}
        source.latest = Tick(TickRecord(0, TickInput(state, (status,)), output, 0.0, False), monotonic_ns())
        panel.take(source.latest.record)
        scene.show(source.latest.record)
        shown = panel.show()
        assert (shown["mode"], shown["reason"], shown["stop"]) == ("DAMPING", "DAMP", "")
        assert shown["stamp"] == str(source.latest.stamp)
        assert "FAULT · can0 · &lt;down&gt;" in panel._summary.content, "what comes from outside is text"
        assert "REMOTE from gravity (7)" in panel._summary.content
        assert "<td>0.25</td>" in panel._joints.content
        assert "<td>61</td>" in panel._joints.content
        assert "DAMPING (damping_controller): DAMP" in panel._event_list.content
        scene.close()
