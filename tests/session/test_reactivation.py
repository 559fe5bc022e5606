from fakes import FakeRobot, FakeSink, FakeSource, session

from humanoid_sim.client import Answer
from humanoid_sim.errors import RobotError
from humanoid_sim.messages import EventKind, Intent, Mode
from humanoid_sim.session.reactivation import Reactivation

DONE = "reactivated: the robot is verified and enabled afresh"


def asked_at(tick, reactivation, **intents):
    """Options of a session in which an operator asks for it during a tick."""
    sink = FakeSink(on_tick=lambda record: reactivation.request() if record.index == tick else None)
    return sink, {"sinks": [sink], "reactivation": reactivation, "duration": 0.4, **intents}


def test_the_stack_begins_again_without_torque():
    reactivation, robot = Reactivation(), FakeRobot()
    sink, options = asked_at(5, reactivation, intents=[FakeSource({1: (Intent.DAMP,)})])
    session(robot, **options).run()
    assert robot.log.count("activate") == 2
    assert reactivation.answer == Answer(True, DONE)
    assert not reactivation.is_requested
    assert sink.events == [DONE, "ending: duration of 0.4 s reached"]
    assert sink.kinds == [EventKind.FRESH_START, EventKind.ENDING]
    modes = [record.output.control_mode.mode for record in sink.records]
    assert modes[:6] == [Mode.ZERO_TORQUE] + [Mode.DAMPING] * 5
    assert set(modes[6:]) == {Mode.ZERO_TORQUE}
    assert sink.records[6].output.control_mode.status_message == "started"
    assert [record.index for record in sink.records] == list(range(len(sink.records)))


def test_of_what_was_asked_for_during_the_activation_only_damp_counts():
    for asked, mode in (((Intent.LOAD_A, Intent.DAMP), Mode.DAMPING), ((Intent.QUIT, Intent.LOAD_A), Mode.ZERO_TORQUE)):
        reactivation, robot = Reactivation(), FakeRobot()
        sink, options = asked_at(5, reactivation, intents=[FakeSource({6: asked})])
        result = session(robot, **options).run()
        assert result.reason == "duration of 0.4 s reached"
        assert {record.output.control_mode.mode for record in sink.records[6:-1]} == {mode}


def test_a_simulated_robot_is_reset_in_motion():
    reactivation, robot = Reactivation(), FakeRobot()
    sink, options = asked_at(5, reactivation, intents=[FakeSource({0: (Intent.DAMP,), 1: (Intent.LOAD_A,)})])
    sink.on_tick = lambda record: reactivation.request(is_reset=True) if record.index == 5 else None
    session(robot, **options).run()
    assert robot.log.count("activate") == 2
    assert sink.kinds[0] is EventKind.FRESH_START
    assert sink.records[8].output.control_mode.mode is Mode.ZERO_TORQUE


def test_in_motion_it_is_refused():
    reactivation, robot = Reactivation(), FakeRobot()
    sink, options = asked_at(5, reactivation, intents=[FakeSource({0: (Intent.DAMP,), 1: (Intent.LOAD_A,)})])
    session(robot, **options).run()
    assert robot.log.count("activate") == 1
    refusal = "REACTIVATE refused: requires ZERO_TORQUE or DAMPING, mode is STANDBY"
    assert sink.events[0] == refusal
    assert reactivation.answer == Answer(False, refusal)
    assert sink.kinds[0] is EventKind.NOTE
    assert sink.records[8].output.control_mode.mode is Mode.STANDBY


def test_an_activation_that_fails_leaves_the_robot_without_torque_and_the_session_running():
    reactivation, robot = Reactivation(), FakeRobot()
    sink, options = asked_at(5, reactivation, intents=[FakeSource({1: (Intent.DAMP,)})])

    def fail():
        if robot.log.count("activate") == 2:
            raise RobotError("lite: 2 problems:\n  - can0: a\n  - can1: b")

    robot.on_activate = fail
    session(robot, **options).run()
    assert sink.events[0] == "REACTIVATE failed: lite: 2 problems: can0: a; can1: b"
    assert reactivation.answer == Answer(False, sink.events[0])
    assert sink.kinds[0] is EventKind.FRESH_START
    control = sink.records[6].output.control_mode
    assert (control.mode, control.status_message) == (Mode.ZERO_TORQUE, "no motor is driven: reactivate failed")
    assert len(sink.records) > 15
