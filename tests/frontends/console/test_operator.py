"""What an operator's page commands of a session, and when that ends."""

import os
from types import SimpleNamespace

import numpy as np
import pytest
from records import record_of

from humanoid_sim.client import Answer, SessionError, monotonic_ns
from humanoid_sim.frontends.attach import Tick
from humanoid_sim.frontends.console import operator as module
from humanoid_sim.frontends.console.operator import Operator
from humanoid_sim.messages import Mode
from humanoid_sim.robots.description import load_robot
from humanoid_sim.testing.healthy import healthy_state

LITE = load_robot("lite")
ELBOW = LITE.joint_names.index("left_elbow_pitch")
POSE = np.array(LITE.standby_controller_a.pose_segments[-1])
SPEEDS = np.array([[-0.5, 0.8], [-0.4, 0.4], [-1.0, 1.0]])


class FakeIntake:
    """Keeps what is sent to a session."""

    def __init__(self):
        self.posted, self.velocities, self.answers = [], [], {}

    def post(self, word, *, seen=None):
        self.posted.append(word)
        return str(len(self.posted))

    def answer(self, token, timeout):
        if token not in self.answers:
            raise SessionError("did not answer")
        return self.answers[token]

    def velocity(self, *values, deliberate, stamp=None):
        self.velocities.append((*values, deliberate))

    def close(self): ...


class Desk:
    """An operator at a session that is in some mode; time passes with `step`."""

    def __init__(self, monkeypatch):
        self.now = monotonic_ns()
        monkeypatch.setattr(module, "monotonic_ns", lambda: self.now)
        monkeypatch.setattr("humanoid_sim.frontends.attach.monotonic_ns", lambda: self.now)
        monkeypatch.setattr(module, "Intake", lambda *_: self.damping)
        monkeypatch.setattr(module, "policy_speeds", lambda _: SPEEDS)
        self.intake, self.damping, self.commands = FakeIntake(), FakeIntake(), []
        self.owners, self.silence, self.position, self.is_open = {}, "", POSE, True
        self.session = SimpleNamespace(
            intake=self.intake,
            session=None,
            header=SimpleNamespace(joint_names=LITE.joint_names),
            description=LITE,
            latest=None,
            status=lambda: {"owners": self.owners},
            send=self.send,
        )
        gate = SimpleNamespace(silence=lambda: self.silence, heartbeat=lambda: self.now, seen=lambda: self.seen)
        self.operator = Operator(self.session, gate)

    @property
    def seen(self):
        return self.now if self.is_open else 0

    def send(self, command, stamp):
        self.commands.append(command)
        return True

    def tick(self, mode, age=0.0):
        record = record_of(healthy_state(self.position, 1.0), mode)
        self.session.latest = Tick(record, self.now - round(1e9 * age))

    def step(self, mode, seconds=0.02, age=0.0):
        self.now += round(1e9 * seconds)
        self.tick(mode, age)
        self.operator.step()

    def run(self, mode, seconds):
        for _ in range(round(seconds / 0.02)):
            self.step(mode)


@pytest.fixture
def desk(monkeypatch):
    desk = Desk(monkeypatch)
    desk.step(Mode.STANDBY)
    return desk


def moving(desk):
    desk.operator.do(desk.operator.take)
    desk.step(Mode.REMOTE)
    return desk


def test_damp_is_sent_at_once_and_again_until_damping_is_seen(desk):
    desk.operator.damp()
    assert desk.damping.posted == ["damp"]
    desk.run(Mode.LOCOMOTION, 0.5)
    assert 4 <= len(desk.damping.posted) <= 6
    count = len(desk.damping.posted)
    desk.run(Mode.DAMPING, 0.04)
    desk.run(Mode.STANDBY, 0.5)
    assert len(desk.damping.posted) == count


def test_an_intent_is_requested_of_what_the_page_has_seen_and_its_answer_is_shown(desk):
    desk.operator.request("start_remote")
    desk.step(Mode.STANDBY)
    assert desk.intake.posted == ["start_remote"]
    desk.intake.answers["1"] = Answer(False, "START_REMOTE refused: requires STANDBY")
    desk.step(Mode.STANDBY)
    assert desk.operator.answer == "START_REMOTE refused: requires STANDBY"
    desk.is_open = False
    desk.operator.request("load_a")
    desk.step(Mode.STANDBY)
    assert len(desk.intake.posted) == 1, "nobody knows what that page had seen"


def test_a_slider_steers_in_locomotion_alone(desk):
    desk.operator.do(desk.operator.steer, 0, 9.0)
    desk.step(Mode.STANDBY)
    assert desk.intake.velocities == [(0.0, 0.0, 0.0, False)]
    assert desk.operator.answer == "velocity let go: mode is STANDBY"
    desk.operator.do(desk.operator.steer, 0, 9.0)
    desk.operator.do(desk.operator.steer, 2, -0.25)
    desk.run(Mode.LOCOMOTION, 0.04)
    assert desk.intake.velocities[1:] == [(0.8, 0.0, -0.25, True), (0.8, 0.0, -0.25, False)]
    desk.operator.do(desk.operator.stop)
    desk.run(Mode.LOCOMOTION, 0.5)
    assert desk.intake.velocities[3:] == [(0.0, 0.0, 0.0, True)], "a slider at rest claims nothing"


def test_a_velocity_ends_with_its_page_and_does_not_come_back(desk):
    desk.operator.do(desk.operator.steer, 0, 0.5)
    desk.run(Mode.LOCOMOTION, 0.2)
    desk.silence = "no heartbeat"
    desk.step(Mode.LOCOMOTION)
    assert desk.intake.velocities[-1] == (0.0, 0.0, 0.0, False)
    assert desk.operator.answer.startswith("velocity let go: ")
    count, desk.silence = len(desk.intake.velocities), ""
    desk.run(Mode.LOCOMOTION, 0.5)
    assert len(desk.intake.velocities) == count


def test_a_joint_is_moved_in_remote_alone(desk):
    desk.operator.do(desk.operator.take)
    desk.step(Mode.STANDBY)
    assert desk.operator.answer == "sliders refused: requires REMOTE, mode is STANDBY"
    moving(desk)
    desk.operator.do(desk.operator.set_goal, ELBOW, -1.6)
    desk.run(Mode.REMOTE, 1.0)
    assert desk.commands[-1].position[ELBOW] == pytest.approx(-1.6)
    assert desk.commands[-1].position[0] == POSE[0]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda desk: setattr(desk, "silence", "no heartbeat"), "no heartbeat"),
        (lambda desk: setattr(desk, "owners", {"REMOTE": "gravity (7)"}), "gravity"),
        (lambda desk: setattr(desk, "position", np.full(LITE.joint_count, np.nan)), "is not known"),
    ],
)
def test_a_joint_that_is_let_go_is_passive_at_once(desk, change, reason):
    desk.owners = {"REMOTE": f"console ({os.getpid()})"}
    moving(desk)
    desk.run(Mode.REMOTE, 3.0)
    assert desk.commands[-1].stiffness.any()
    change(desk)
    desk.step(Mode.REMOTE)
    assert not desk.commands[-1].stiffness.any()
    assert desk.commands[-1].damping.all()
    assert reason in desk.operator.answer
    count = len(desk.commands)
    desk.run(Mode.REMOTE, 0.1)
    assert len(desk.commands) == count


def test_a_joint_is_let_go_where_the_mode_ends_or_the_session_or_the_console_stands_still(desk):
    moving(desk)
    count = len(desk.commands)
    desk.step(Mode.DAMPING)
    assert len(desk.commands) == count, "no command of its own in another mode"
    moving(desk)
    desk.step(Mode.REMOTE, age=0.6)
    assert desk.operator.sliders is None
    moving(desk)
    desk.run(Mode.REMOTE, 2.0)
    desk.step(Mode.REMOTE, seconds=0.3)
    assert desk.commands[-1].stiffness.max() < 5.0, "after missing commands the gains come in anew"
    desk.step(Mode.REMOTE, seconds=0.6)
    assert "held up" in desk.operator.answer
