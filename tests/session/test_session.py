import numpy as np
import pytest
import rig
from fakes import (
    BrokenError,
    FakeRemote,
    FakeRobot,
    FakeSink,
    FakeSource,
    LoggingSupervisor,
    is_damping,
    is_zero,
    session,
)

import humanoid_sim.session.session as loop
from humanoid_sim.controllers.live_inputs import LiveInputs
from humanoid_sim.controllers.reference import no_reference
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.controllers.terms import Term
from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.messages import Intent, Mode, SafetyFlag, SafetyLevel, SafetyStatus, SessionHeader
from humanoid_sim.mit import Extern
from humanoid_sim.session import pace
from humanoid_sim.session.pace import LoopSettings
from humanoid_sim.session.session import Session

REST_TICKS = 25
"""0.5 s at the rig's 50 Hz, for which all joints must be slow before a run ends."""

TO_STANDBY = {0: (Intent.DAMP,), 1: (Intent.LOAD_A,)}
TO_LOCOMOTION = {**TO_STANDBY, 6: (Intent.START_LOCOMOTION,)}


# Order.


def test_one_tick_reads_collects_steps_writes_and_hands_out():
    log = []
    stack = LoggingSupervisor(rig.JOINTS, rig.supervisor().controllers, log)
    robot, source, sink = FakeRobot(log), FakeSource(finish_at=2, log=log), FakeSink(log)
    session(robot, supervisor=stack, intents=[source], remote=FakeRemote(log), sinks=[sink]).run()
    tick = ["read", "poll", "remote", "step", "write", "hand out"]
    last = ["read", "remote", "step", "write", "hand out"]  # the loop's own QUIT: the sources are not asked any more
    assert log == ["start sink", "activate", *tick, *tick, *tick, *last, "close robot", "close sink"]


def test_sources_see_the_time_of_this_tick_and_the_output_of_the_one_before():
    source, sink = FakeSource(finish_at=3), FakeSink()
    session(FakeRobot(), intents=[source], sinks=[sink]).run()
    assert [time for time, _ in source.seen] == [0.0, 0.02, 0.04, 0.06]
    assert source.seen[0][1] is None
    for k in (1, 2, 3):
        assert source.seen[k][1] is sink.records[k - 1].output


def test_a_tick_takes_all_sources_and_live_terms_beside_the_robots_own():
    own, live = Extern(np.ones(2), 0.0), Extern(np.zeros(3), 0.0)

    class Live:
        def latest(self):
            return {"velocity": live}

    robot, sink = FakeRobot(extern={"key_pressed": own}), FakeSink()
    sources = [FakeSource({0: (Intent.LOAD_A,)}), FakeSource({0: (Intent.DAMP,)}, finish_at=0)]
    session(robot, intents=sources, externs=[Live()], sinks=[sink]).run()
    first = sink.records[0].input
    assert first.intents == (Intent.LOAD_A, Intent.DAMP)
    assert dict(first.state.extern) == {"key_pressed": own, "velocity": live}


def live_supervisor():
    """The rig's, with a policy that observes the joints and two values that only a program knows."""
    wiring = rig.contract(
        task_type="locomotion", body_names=(), observation=(Term("foot_contact", width=2), "joint_pos")
    )
    policy = RLPolicyController(
        rig.JOINTS, wiring, no_reference(), rig.good_answer, control_period=rig.PERIOD, extern=wiring.live_inputs
    )
    return rig.supervisor(rl_policy_controller=policy)


def live_inputs(source):
    controller = live_supervisor().controllers["rl_policy_controller"]
    assert isinstance(controller, RLPolicyController)
    return LiveInputs(controller.contract, {"foot_contact": source})


def driven_live(live):
    """The ticks of a run to LOCOMOTION, of a policy that observes a live input."""
    sink = FakeSink()
    options = {} if live is None else {"live": live_inputs(live)}
    intents = [FakeSource(TO_LOCOMOTION)]
    session(FakeRobot(), supervisor=live_supervisor(), duration=0.4, intents=intents, sinks=[sink], **options).run()
    return sink.records


def test_a_callable_feeds_a_live_input_and_its_values_are_in_the_ticks():
    records = driven_live(lambda state: [state.time, 0.5])
    steps = [record for record in records if record.output.policy_step is not None]
    assert len(steps) >= 3
    for record in steps:
        time = record.input.state.time
        assert record.output.policy_step.observation[:2].tolist() == [np.float32(time), 0.5]
        assert record.input.state.extern["foot_contact"].arrival_time == time
    # What was decided follows from the recorded inputs alone.
    again = live_supervisor()
    memory = again.initial()
    for record in records:
        memory, output = again.step(memory, record.input)
        np.testing.assert_array_equal(output.command.position, record.output.command.position)
        assert output.control_mode == record.output.control_mode


@pytest.mark.parametrize(
    ("live", "reason"),
    [
        (lambda _: [1.0, np.inf], "observation foot_contact[1] is inf, expected a finite number"),
        (lambda _: np.ones(3), "MITState.extern['foot_contact']: has shape (3,), expected (2,)"),
    ],
    ids=["not finite", "another shape"],
)
def test_a_live_input_that_is_wrong_is_a_fault_and_never_zeros(live, reason):
    records = driven_live(live)
    modes = [record.output.control_mode for record in records]
    assert not any(record.output.policy_step for record in records)
    assert any(mode.mode is Mode.DAMPING and reason in mode.status_message for mode in modes)


def test_without_its_live_input_the_policy_does_not_start():
    records = driven_live(None)
    refused = {text for record in records for text in record.output.refusals}
    assert refused == {"START_LOCOMOTION refused: the live input 'foot_contact' (/foot_contact) has not come yet"}
    assert Mode.LOCOMOTION not in {record.output.control_mode.mode for record in records}
    assert not any(record.output.faults for record in records)


def test_the_safety_filter_decides_what_the_supervisor_sees():
    fault = SafetyStatus(SafetyLevel.FAULT, SafetyFlag.BUS_OFF, "can0")
    sink = FakeSink()
    run = session(
        FakeRobot(), duration=0.1, intents=[FakeSource(TO_STANDBY)], sinks=[sink], safety_filter=lambda _: (fault,)
    )
    run.run()
    assert sink.records[1].input.safety == (fault,)
    assert run.mode is Mode.DAMPING
    assert sink.records[1].output.refusals == ("LOAD_A refused: safety FAULT BUS_OFF from can0",)


# Ends.


def ended_damped(robot):
    """Check that the run ended in DAMPING, then closed; the number of DAMPING's commands at its end."""
    assert robot.is_closed
    assert robot.log[-1] == "close robot"
    count = 0
    for command in reversed(robot.commands):
        if not is_damping(command):
            break
        count += 1
    assert count > 0
    return count


def test_a_run_ends_after_its_duration_through_damping():
    robot, sink = FakeRobot(), FakeSink()
    result = session(robot, duration=0.5, intents=[FakeSource(TO_STANDBY)], sinks=[sink]).run()
    assert result.reason == "duration of 0.5 s reached"
    assert sink.records[25].output.control_mode.mode is Mode.STANDBY  # at 0.50 s
    assert sink.records[26].output.control_mode.mode is Mode.DAMPING
    assert ended_damped(robot) == REST_TICKS + 2
    assert result.ticks == len(sink.records) == robot.writes
    assert result.duration == pytest.approx(result.ticks * rig.PERIOD)
    assert sink.records[-1].output.quit
    assert sink.events == ["ending: duration of 0.5 s reached"]
    assert (result.skipped, result.failures) == (0, ())


def test_a_run_ends_when_a_source_wants_it():
    robot = FakeRobot()
    result = session(robot, intents=[FakeSource(), FakeSource(TO_STANDBY, finish_at=7)]).run()
    assert result.reason == "script finished"
    assert ended_damped(robot) == REST_TICKS + 2


def test_quit_in_damping_stays_there_until_the_joints_rest():
    """The arms may still be falling when QUIT comes right after DAMP."""
    robot = FakeRobot()
    result = session(robot, intents=[FakeSource({0: (Intent.DAMP,), 3: (Intent.QUIT,)})]).run()
    assert result.reason == "QUIT"
    assert ended_damped(robot) == 4 + REST_TICKS + 2


def test_without_torque_quit_ends_at_once_and_a_run_brings_none():
    result = session(FakeRobot(), intents=[FakeSource({3: (Intent.QUIT,)})]).run()
    assert (result.reason, result.ticks) == ("QUIT", 5)
    robot = FakeRobot()
    result = session(robot, duration=0.1).run()
    assert all(is_zero(command) for command in robot.commands)
    assert result.ticks == 7  # 0.00 to 0.10 s, and QUIT
    assert robot.is_closed


def test_quit_is_refused_in_motion_and_the_run_goes_on():
    sink, source = FakeSink(), FakeSource({**TO_STANDBY, 3: (Intent.QUIT,)})
    result = session(FakeRobot(), duration=0.2, intents=[source], sinks=[sink]).run()
    assert result.reason == "duration of 0.2 s reached"
    assert sink.records[3].output.refusals == ("QUIT refused: requires ZERO_TORQUE or DAMPING, mode is STANDBY",)


def test_arms_that_were_held_still_are_not_at_rest_when_damping_begins():
    def falling(count):  # held still until DAMPING, then falling for 0.4 s
        robot.velocity = 0.5 if 20 < robot.writes < 40 else 0.0

    robot = FakeRobot(on_read=falling)
    session(robot, duration=0.4, intents=[FakeSource(TO_STANDBY)]).run()
    assert robot.writes > 40 + REST_TICKS


def test_joints_that_never_rest_do_not_keep_a_run_from_ending():
    robot = FakeRobot(velocity=1.0)
    source = FakeSource(TO_STANDBY)
    result = session(robot, duration=0.2, damping_time=1.0, intents=[source]).run()
    assert ended_damped(robot) == 1 + 50 + 1  # DAMP, one second, QUIT
    assert source.polls == result.ticks - 2  # whoever asks meanwhile is answered


def test_a_velocity_that_is_unknown_is_no_motion():
    robot = FakeRobot(velocity=np.nan)
    session(robot, duration=0.2, intents=[FakeSource(TO_STANDBY)]).run()
    assert ended_damped(robot) == REST_TICKS + 2


def test_a_request_to_stop_ends_through_damping():
    robot, sink = FakeRobot(), FakeSink()
    run = session(robot, intents=[FakeSource(TO_LOCOMOTION)], sinks=[sink])
    sink.on_tick = lambda record: run.request_stop("SIGTERM") if record.index == 10 else None
    result = run.run()
    assert result.reason == "SIGTERM"
    assert sink.records[10].output.control_mode.mode is Mode.LOCOMOTION
    assert ended_damped(robot) == REST_TICKS + 2


def test_a_second_request_to_stop_does_not_wait_for_rest_but_damps():
    robot, sink = FakeRobot(velocity=1.0), FakeSink()
    run = session(robot, intents=[FakeSource(TO_LOCOMOTION)], sinks=[sink])
    sink.on_tick = lambda record: run.request_stop(f"at {record.index}") if record.index in (10, 15) else None
    result = run.run()
    assert result.reason == "at 10"
    assert ended_damped(robot) == 6  # ticks 11 to 16, the last of them QUIT


def test_a_request_before_the_first_tick_closes_the_robot_untouched():
    robot = FakeRobot()
    run = session(robot)
    run.request_stop("early")
    assert run.run().ticks == 0
    assert robot.log == ["activate", "close robot"]


def test_a_robot_that_cannot_be_activated_is_closed():
    robot, sink = FakeRobot(activation_error=RobotError("joint 3 is silent")), FakeSink()
    with pytest.raises(RobotError, match="joint 3"):
        session(robot, sinks=[sink]).run()
    assert robot.log == ["activate", "close robot"]
    assert sink.log == ["start sink", "close sink"]


def test_a_sink_that_cannot_start_keeps_the_robot_from_being_activated():
    class Unwritable(FakeSink):
        def start(self, header):
            raise InputError("run.mcap: cannot be written")

    log = []
    with pytest.raises(InputError, match=r"run\.mcap"):
        session(FakeRobot(log), sinks=[FakeSink(log, name="first"), Unwritable(log)]).run()
    assert log == ["start first", "close robot", "close first"]


def raise_broken(*_):
    raise BrokenError("deliberate")


def broken_at(count):
    return lambda i: raise_broken() if i == count else None


def broken_from(count):
    return lambda i: raise_broken() if i >= count else None


def _source_that_breaks(robot):
    source = FakeSource(TO_STANDBY)
    source.poll = lambda time, output: raise_broken() if source.polls > 8 else FakeSource.poll(source, time, output)
    return {"intents": [source]}


def _supervisor_that_breaks(robot):
    stack = rig.supervisor()
    broken = LoggingSupervisor(
        rig.JOINTS, stack.controllers, on_step=lambda tick: raise_broken() if tick.state.time > 0.15 else None
    )
    return {"supervisor": broken, "intents": [FakeSource(TO_STANDBY)]}


BREAKAGES = {
    "read once": lambda robot: setattr(robot, "on_read", broken_at(8)) or {},
    "read for good": lambda robot: setattr(robot, "on_read", broken_from(8)) or {},
    "write once": lambda robot: setattr(robot, "on_write", broken_at(8)) or {},
    "intent source": _source_that_breaks,
    "supervisor": _supervisor_that_breaks,
    "safety filter": lambda robot: {"safety_filter": lambda s: raise_broken() if robot.writes > 8 else s},
    "qpos": lambda robot: {"qpos": lambda: raise_broken() if robot.writes > 8 else np.zeros(1)},
}


@pytest.mark.parametrize("name", BREAKAGES)
def test_an_exception_in_motion_comes_out_after_damping(name):
    robot, sink = FakeRobot(), FakeSink()
    options = {"intents": [FakeSource(TO_STANDBY)], **BREAKAGES[name](robot)}
    with pytest.raises(BrokenError, match="deliberate"):
        session(robot, sinks=[sink], **options).run()
    assert ended_damped(robot) == REST_TICKS + 1
    assert sink.events == ["ended by BrokenError: deliberate"]
    assert sink.log[-1] == "close sink"


def test_a_robot_that_takes_no_command_any_more_is_still_asked_to_damp_and_closed():
    robot = FakeRobot(velocity=1.0, on_write=broken_from(8))
    with pytest.raises(BrokenError):
        session(robot, damping_time=1.0, intents=[FakeSource(TO_STANDBY)]).run()
    assert robot.writes == 8 + 1 + 51
    assert robot.is_closed


@pytest.mark.parametrize(("breaks", "commands"), [(broken_at(3), 4), (broken_from(0), 1)])
def test_an_exception_without_torque_or_before_any_state_is_known_brings_none(breaks, commands):
    robot = FakeRobot(on_read=breaks)
    with pytest.raises(BrokenError):
        session(robot).run()
    assert [is_zero(command) for command in robot.commands] == [True] * commands
    assert robot.is_closed


def test_an_exception_while_ending_damps_too():
    robot = FakeRobot(on_write=broken_at(15))
    with pytest.raises(BrokenError):
        session(robot, duration=0.2, intents=[FakeSource(TO_STANDBY)]).run()
    assert ended_damped(robot) > REST_TICKS


def test_a_robot_that_does_not_confirm_its_end_makes_the_run_a_failure():
    class Unconfirmed(FakeRobot):
        def close(self):
            super().close()
            raise RobotError("left: not known to be off")

    sink = FakeSink()
    summary = session(Unconfirmed(), duration=0.1, sinks=[sink]).run()
    assert summary.failures == ("robot: left: not known to be off",)
    assert sink.events[-1] == "failed to close the robot: left: not known to be off"


def test_every_sink_is_closed_whatever_raises():
    class Unclosable(FakeSink):
        def close(self):
            super().close()
            raise BrokenError("close")

    class UnclosableRobot(FakeRobot):
        def close(self):
            super().close()
            raise BrokenError("robot")

    log = []
    sinks = [FakeSink(log, name="a"), Unclosable(log, name="b"), FakeSink(log, name="c")]
    with pytest.raises(BrokenError):
        session(UnclosableRobot(log), duration=0.1, sinks=sinks).run()
    assert log[-4:] == ["close robot", "close c", "close b", "close a"]


# Sinks.


def test_a_sink_that_raises_is_left_out_and_the_run_goes_on():
    broken, sink = FakeSink(), FakeSink()
    broken.on_tick = lambda record: raise_broken() if record.index == 3 else None
    result = session(FakeRobot(), duration=0.2, sinks=[broken, sink]).run()
    assert result.failures == ("FakeSink: BrokenError: deliberate",)
    assert [record.index for record in broken.records] == [0, 1, 2]
    assert [record.index for record in sink.records] == list(range(result.ticks))
    assert sink.events[0] == "left out from here on: FakeSink: BrokenError: deliberate"
    assert broken.log[-1] == "close sink"
    broken, sink = FakeSink(), FakeSink()
    broken.event = raise_broken
    result = session(FakeRobot(), duration=0.1, sinks=[broken, sink]).run()
    assert result.failures == ("FakeSink: BrokenError: deliberate",), "at an event"
    assert sink.events == [f"left out from here on: {result.failures[0]}", "ending: duration of 0.1 s reached"]


# Time.


class FakeClock:
    """Time passes when somebody sleeps, and a little with every look at the clock."""

    def __init__(self, monkeypatch):
        self.now = 100.0
        self.slept = []
        for module in (loop, pace):
            monkeypatch.setattr(module, "perf_counter", self.look)
            monkeypatch.setattr(module, "sleep", self.sleep)

    def look(self):
        self.now += 1e-6
        return self.now

    def sleep(self, seconds):
        self.slept.append(seconds)
        self.now += seconds


def test_a_missed_deadline_is_skipped_never_caught_up(monkeypatch):
    clock = FakeClock(monkeypatch)
    starts = []

    def stall(count):
        if count == 3:
            clock.now += 0.05  # two and a half periods

    robot = FakeRobot(on_read=lambda _: starts.append(clock.now - 100.0), on_write=stall)
    sink = FakeSink()
    result = session(robot, realtime=True, duration=0.12, sinks=[sink]).run()
    assert starts == pytest.approx([0.0, 0.02, 0.04, 0.06, 0.12, 0.14, 0.16, 0.18], abs=1e-3)
    assert (result.overruns, result.skipped) == (1, 2)
    assert [record.overrun for record in sink.records] == [False, False, False, True, False, False, False, False]
    assert [record.index for record in sink.records] == list(range(8))


def test_a_slow_sink_makes_the_loop_skip_but_not_stop(monkeypatch):
    clock = FakeClock(monkeypatch)
    starts = []
    sink = FakeSink(on_tick=lambda record: clock.sleep(0.03 if record.index == 1 else 0.0))
    robot = FakeRobot(on_read=lambda _: starts.append(clock.now - 100.0))
    result = session(robot, realtime=True, duration=0.1, sinks=[sink]).run()
    assert result.overruns == 1
    assert np.diff(starts).min() > 0.005  # nothing is run off in a burst
    assert result.ticks == 7


def test_ticks_driven_by_hand_have_no_deadline_in_the_past(monkeypatch):
    FakeClock(monkeypatch)
    sink = FakeSink()
    run = session(FakeRobot(), realtime=True, sinks=[sink])
    for _ in range(3):
        run.tick(())
    assert [record.overrun for record in sink.records] == [False, False, False]


def test_without_real_time_a_slow_tick_counts_but_nothing_is_waited_for(monkeypatch):
    clock = FakeClock(monkeypatch)
    stall = lambda count: clock.sleep(0.05) if count == 2 else None  # noqa: E731
    result = session(FakeRobot(on_write=stall), duration=0.1).run()
    assert (result.overruns, result.skipped, clock.slept) == (1, 0, [0.05]), "no sleep but the tick's own"


def test_only_a_run_without_deadlines_waits_for_a_sink_that_lags(monkeypatch):
    clock = FakeClock(monkeypatch)
    sink = FakeSink()
    sink.waiting = [5000, 4000, 2001, 2000]
    session(FakeRobot(), duration=0.02, sinks=[sink]).run()
    assert clock.slept == [0.001] * 3
    sink = FakeSink()
    sink.waiting = [5000] * 100
    session(FakeRobot(), realtime=True, duration=0.02, sinks=[sink]).run()
    assert sink.questions == 0


def test_a_sink_that_never_catches_up_does_not_keep_a_run_from_being_stopped(monkeypatch):
    sink = FakeSink()
    sink.waiting = [5000] * 10**6
    run = session(FakeRobot(), sinks=[sink])
    waits = []

    def sleep(seconds):
        waits.append(seconds)
        if len(waits) == 5:
            run.request_stop("SIGINT")

    monkeypatch.setattr(loop, "sleep", sleep)
    assert run.run().reason == "SIGINT"


def test_the_duration_of_a_tick_leaves_out_the_physics_of_a_simulated_robot(monkeypatch):
    clock = FakeClock(monkeypatch)
    header = SessionHeader("fake", rig.JOINTS, 0.02, 0)
    for simulated, expected in ((True, 0.0), (False, 0.003)):
        sink, robot = FakeSink(), FakeRobot(on_write=lambda _: clock.sleep(0.003))
        settings = LoopSettings(rig.PERIOD, realtime=False, simulated=simulated, duration=0.1)
        Session(robot, rig.supervisor(), settings, header=header, sinks=[sink]).run()
        assert sink.records[1].duration == pytest.approx(expected, abs=1e-4)
