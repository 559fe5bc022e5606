import pytest
from fakes import FakeRobot, FakeSink, FakeSource, session

from humanoid_sim.client import Answer
from humanoid_sim.errors import RobotError
from humanoid_sim.messages import EventKind, Intent, Mode
from humanoid_sim.session.requests import Requests

DONE = "reactivated: the robot is verified and enabled afresh"
REFUSED = "REACTIVATE refused: requires ZERO_TORQUE or DAMPING, mode is STANDBY"
STANDING = {0: (Intent.DAMP,), 1: (Intent.LOAD_A,)}


def run(intents, robot=None, *, is_reset=False):
    """Request a fresh start in tick 5; the robot, the sink, the answer."""
    requests, robot, sink = Requests(), robot or FakeRobot(), FakeSink()
    sink.on_tick = lambda record: requests.reactivate(is_reset=is_reset) if record.index == 5 else None
    session(robot, duration=0.4, intents=[FakeSource(intents)], sinks=[sink], requests=requests).run()
    assert [record.index for record in sink.records] == list(range(len(sink.records)))
    return robot, sink, requests.answer


def test_the_stack_begins_again_without_torque():
    robot, sink, answer = run({1: (Intent.DAMP,)})
    assert robot.log.count("activate") == 2
    assert answer == Answer(True, DONE)
    assert sink.events == [(DONE, EventKind.FRESH_START), ("ending: duration of 0.4 s reached", EventKind.ENDING)]
    modes = [record.output.control_mode.mode for record in sink.records]
    assert modes[:6] == [Mode.ZERO_TORQUE] + [Mode.DAMPING] * 5
    assert set(modes[6:]) == {Mode.ZERO_TORQUE}
    assert sink.records[6].output.control_mode.status_message == "started"


@pytest.mark.parametrize(
    ("requested", "mode"),
    [((Intent.LOAD_A, Intent.DAMP), Mode.DAMPING), ((Intent.QUIT, Intent.LOAD_A), Mode.ZERO_TORQUE)],
)
def test_of_what_was_requested_during_the_activation_only_damp_counts(requested, mode):
    _, sink, _ = run({6: requested})
    assert {record.output.control_mode.mode for record in sink.records[6:-1]} == {mode}


@pytest.mark.parametrize(
    ("is_reset", "activations", "event", "mode"),
    [(True, 2, (DONE, EventKind.FRESH_START), Mode.ZERO_TORQUE), (False, 1, (REFUSED, EventKind.NOTE), Mode.STANDBY)],
)
def test_in_motion_a_simulated_robot_is_reset_and_no_other(is_reset, activations, event, mode):
    robot, sink, answer = run(STANDING, is_reset=is_reset)
    assert robot.log.count("activate") == activations
    assert sink.events[0] == event
    assert answer == Answer(is_reset, event[0])
    assert sink.records[8].output.control_mode.mode is mode


def test_an_activation_that_fails_leaves_the_robot_without_torque_and_the_session_running():
    robot = FakeRobot()

    def fail():
        if robot.log.count("activate") == 2:
            raise RobotError("lite: 2 problems:\n  - can0: a\n  - can1: b")

    robot.on_activate = fail
    _, sink, answer = run({1: (Intent.DAMP,)}, robot)
    assert answer == Answer(False, "REACTIVATE failed: lite: 2 problems: can0: a; can1: b")
    assert sink.events[0] == (answer.text, EventKind.FRESH_START)
    control = sink.records[6].output.control_mode
    assert (control.mode, control.status_message) == (Mode.ZERO_TORQUE, "no motor is driven: reactivate failed")
    assert len(sink.records) > 15
