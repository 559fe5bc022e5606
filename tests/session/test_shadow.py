"""A shadow policy sees what LOCOMOTION would see and says what it would command; no tick differs because of it."""

import threading
from dataclasses import replace

import numpy as np
import pytest
import rig
from fakes import FakeRobot, FakeSink, FakeSource, session

from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.messages import Intent, Mode
from humanoid_sim.recording.codec import TickEncoder
from humanoid_sim.session import sinks
from humanoid_sim.session.shadow import ShadowSink

INTENTS = {1: (Intent.DAMP,), 3: (Intent.LOAD_A,)}
"""By tick: DAMPING in 1 and 2, STANDBY from 3 on, which has reached its pose in 6."""
TICKS = 16
LIMIT = np.array([10.0, 10.0, 10.0])


def controller(policy=rig.good_answer):
    """An inference every two ticks."""
    return RLPolicyController(
        rig.JOINTS, rig.contract(), rig.reference(), policy, control_period=rig.PERIOD, extern={"velocity": 3}
    )


class Shadowed:
    """A run with a shadow policy, and what came of it."""

    def __init__(self, policy=None, *, realtime=False):
        self.steps = []
        self.told = []
        self.shadow = ShadowSink(
            controller(policy or rig.good_answer),
            "p.onnx",
            LIMIT,
            realtime=realtime,
            publish=self.steps.append,
            tell=self.told.append,
        )

    def run(self):
        return run(self.shadow)


def run(*others, intents=None, policy=None):
    """The ticks of a session whose control stack has no policy, unless it is given one."""
    sink = FakeSink()
    stack = rig.supervisor(rl_policy_controller=policy, remote_policy_controller=None)
    source = FakeSource(intents or INTENTS)
    session(FakeRobot(), supervisor=stack, intents=[source], duration=TICKS * rig.PERIOD, sinks=[sink, *others]).run()
    return sink.records


def control_log(records):
    """Everything in the ticks but how long they took."""
    encoder = TickEncoder(len(rig.JOINTS))
    return [encoder.encode(replace(record, duration=0.0, overrun=False)) for record in records]


def test_it_runs_in_damping_and_standby_and_begins_afresh_where_locomotion_would():
    shadowed = Shadowed()
    records = shadowed.run()
    modes = [record.output.control_mode.mode for record in records[:TICKS]]
    assert modes == [Mode.ZERO_TORQUE] + 2 * [Mode.DAMPING] + 13 * [Mode.STANDBY]
    seen = [(step.tick, step.step.frame) for step in shadowed.steps if step.step is not None and step.tick < TICKS]
    assert seen == [(1, 0), (3, 0), (5, 1), (6, 0), (8, 1), (10, 2), (12, 3), (14, 3)]
    assert all(step.fault == "" and step.command is not None for step in shadowed.steps)
    assert [step.time for step in shadowed.steps[:2]] == [0.02, 0.06]
    figures = shadowed.shadow.figures()
    assert (figures["policy"], figures["steps"], figures["faults"]) == ("p.onnx", len(shadowed.steps), 0)
    assert (figures["left_out"], figures["behind"], figures["first_fault"]) == (0, 0.0, None)
    assert [event.text for event in shadowed.told] == ["shadow policy p.onnx: nothing of it reaches a motor"]


def test_it_says_what_locomotion_would_command():
    shadowed = Shadowed()
    shadowed.run()
    drives = run(intents={**INTENTS, 8: (Intent.START_LOCOMOTION,)}, policy=controller())
    driven = next(record for record in drives if record.output.policy_step is not None)
    (shown,) = [step for step in shadowed.steps if step.tick == 6]
    assert driven.index == 8
    np.testing.assert_array_equal(shown.step.observation, driven.output.policy_step.observation)
    np.testing.assert_array_equal(shown.step.action, driven.output.policy_step.action)
    for name in ("position", "velocity", "effort", "stiffness", "damping"):
        np.testing.assert_array_equal(getattr(shown.command, name), getattr(driven.output.command, name))
    offset = np.abs(shown.command.position - rig.KNOWN)
    assert shadowed.shadow.largest_offset >= offset.max() > 0.1
    assert shadowed.shadow.largest_joint in rig.JOINTS


@pytest.mark.parametrize("name", rig.BAD_ANSWERS)
def test_a_policy_that_misbehaves_changes_no_tick_and_is_told(name):
    plain = control_log(run())
    shadowed = Shadowed(rig.BAD_ANSWERS[name])
    assert control_log(shadowed.run()) == plain
    assert shadowed.shadow.error is None
    assert len(plain) > TICKS
    assert shadowed.shadow.steps == 0
    assert shadowed.shadow.faults == len(shadowed.steps) >= 8
    assert [step.tick for step in shadowed.steps[:4]] == [1, 3, 5, 6]  # tried again with each period of the policy
    assert all(step.fault and step.command is None for step in shadowed.steps)
    assert [event.text.startswith("shadow policy: failed: ") for event in shadowed.told] == [False, True]


def test_a_policy_that_ends_its_thread_changes_no_tick():
    def leaving(*_):
        raise SystemExit(3)

    shadowed = Shadowed(leaving)
    assert control_log(shadowed.run()) == control_log(run())
    assert isinstance(shadowed.shadow.error, SystemExit)


def test_a_policy_that_does_not_answer_holds_nobody_up(monkeypatch):
    monkeypatch.setattr(sinks, "_STUCK_AFTER", 0.05)
    answer = threading.Event()

    def silent(observation, frame):
        answer.wait()
        return rig.good_answer(observation, frame)

    shadowed = Shadowed(silent)
    try:
        assert control_log(shadowed.run()) == control_log(run())
        assert isinstance(shadowed.shadow.error, TimeoutError)
    finally:
        answer.set()
        shadowed.shadow._thread.join()


def test_what_it_would_see_too_late_is_left_out_and_told():
    records, shadowed = run(), Shadowed(realtime=True)
    for record in 4 * records[:TICKS]:
        shadowed.shadow.tick(record)
    assert (shadowed.shadow.lost, shadowed.shadow.backlog) == (14, 50)  # 1 s waits at most
    late = Shadowed()
    for index in (0, 1, 2, 9):
        late.shadow.handle_tick(records[index])
    assert [(step.tick, step.step.frame) for step in late.steps if step.step is not None] == [(1, 0), (9, 0)]
    assert [event.text for event in late.told] == ["shadow policy: 6 ticks left out: it is too slow"]
    late.shadow._newest = 14
    assert late.shadow.figures()["behind"] == pytest.approx(0.1)


def test_without_a_policy_in_the_stack_no_intent_leaves_damping_and_standby():
    shadowed = Shadowed()
    asked = {8: (Intent.START_LOCOMOTION,), 10: (Intent.START_REMOTE,)}
    records = run(shadowed.shadow, intents={**INTENTS, **asked})
    assert {record.output.control_mode.mode for record in records[8:TICKS]} == {Mode.STANDBY}
    assert [len(records[index].output.refusals) for index in (8, 10)] == [1, 1]
