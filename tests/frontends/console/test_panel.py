"""What the page shows of a robot, without a browser."""

from types import SimpleNamespace

import numpy as np
import pytest
from records import record_of

from humanoid_sim.client import monotonic_ns
from humanoid_sim.frontends.attach import Source, Tick
from humanoid_sim.frontends.console.gate import Gate
from humanoid_sim.frontends.console.panel import Panel
from humanoid_sim.frontends.console.scene import Scene
from humanoid_sim.messages import Mode, SafetyLevel, SafetyStatus
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import build_model
from humanoid_sim.stack import run_header
from humanoid_sim.testing.healthy import healthy_state

LITE = load_robot("lite")


class Motors(Source):
    """A robot on a bus, watched only."""

    is_hardware = True
    header = run_header(LITE, 0.02, None, settings={})

    def model(self):
        return build_model(LITE)

    def status(self):
        return {"owners": {"REMOTE": "gravity (7)"}, "recording": {"file": "r.mcap", "error": None}}


class Simulation(Motors):
    """A session whose first status comes after the page."""

    is_hardware = False
    bodies: tuple[str, ...] = ()

    def status(self):
        return {"simulation": {"bodies": self.bodies}}


@pytest.fixture
def scene():
    scene = Scene(Gate("127.0.0.1", 0).serve(), Motors())
    yield scene
    scene.close()


def tick(time, *statuses):
    state = healthy_state(np.full(LITE.joint_count, 0.25), time)
    return Tick(record_of(state, Mode.DAMPING, "DAMP", *statuses), monotonic_ns())


def test_a_body_can_be_pushed_once_the_session_says_which(scene, monkeypatch):
    gui, folders, add = scene.server.gui, [], scene.server.gui.add_folder
    monkeypatch.setattr(gui, "add_folder", lambda label, **rest: folders.append(label) or add(label, **rest))
    operator = SimpleNamespace(speeds=None, sliders=None, velocity=(), answer="", set_goal=None)
    source = Simulation()
    panel, source.latest = Panel(source, scene, operator), tick(0.0)
    for bodies in ((), ("pelvis",), ("pelvis",)):
        source.bodies = bodies
        panel.show()
    assert folders == ["Joints in REMOTE", "Plots", "Push"]


def test_a_watched_robot_s_mode_safety_and_plots_are_shown(scene):
    source, status = Motors(), SafetyStatus(SafetyLevel.FAULT, source="can0", message="<down>")
    panel = Panel(source, scene, None)
    assert panel.show() == {"age": 0.0}
    panel._plots._shown.append(("left_elbow_pitch position, rad", SimpleNamespace()))
    for time in (3.0, 3.001, 3.02, 0.5, 0.52):
        source.latest = tick(time, status)
        panel.take(source.latest.record)
    scene.show(source.latest.record)
    shown = panel.show()
    assert (shown["control"], shown["mode"], shown["reason"]) == (False, "DAMPING", "DAMP")
    assert shown["stamp"] == str(source.latest.stamp)
    assert "FAULT · can0 · &lt;down&gt;" in panel._summary.content, "what comes from outside is text"
    assert "REMOTE from gravity (7)" in panel._summary.content
    times, position, command = panel._plots._shown[0][1].data
    assert times.tolist() == [0.5, 0.52], "its clock began again"
    assert (position.tolist(), command.tolist()) == ([0.25, 0.25], [0.0, 0.0])
