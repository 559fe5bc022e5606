"""However a run ends, the joints are damped until they rest and the robot is closed first; on a virtual clock."""

from math import inf

import numpy as np
import pytest
from session_surface import JOINTS, PERIOD, REST_POSITION, FakeRun, VirtualClock

from humanoid_sim.messages import Intent, Mode
from humanoid_sim.mit import MITState

REST = round(0.5 / PERIOD)
"""Ticks for which all joints must be slow before a run ends."""
LIMIT = round(3.0 / PERIOD)
"""Ticks that a run waits at most for joints that do not rest."""
TROUBLE = 10
"""Tick in which something happens, in STANDBY."""


class BrokenError(Exception):
    """What the fakes raise."""


def nothing(place, count):
    """Something is reached for the n-th time, counted from 0."""


class Robot:
    """Joints at rest unless `velocity` says otherwise; `reach` is called at every read and write."""

    joints = JOINTS

    def __init__(self, log, reach=nothing, velocity=lambda _: 0.0, age=0.0):
        self.log, self.reach, self.velocity, self.age = log, reach, velocity, age
        self.reads = self.writes = 0
        self.commands = []
        """Each with the number of its write."""

    def activate(self):
        self.log.append("activate")

    def read(self):
        self.reads += 1
        self.reach("read", self.reads - 1)
        n = len(JOINTS)
        velocity, age, imu = np.zeros(n), np.zeros(n), (np.array([1.0, 0, 0, 0]), np.zeros(3), np.array([0, 0, 9.81]))
        velocity[3], age[3] = self.velocity(self.writes), self.age
        return MITState(self.writes * PERIOD, REST_POSITION, velocity, np.zeros(n), age, *imu), ()

    def write(self, command):
        assert "close robot" not in self.log
        self.writes += 1
        self.reach("write", self.writes - 1)
        self.commands.append((self.writes - 1, command))

    def close(self):
        self.log.append("close robot")

    def after(self, tick):
        return [command for number, command in self.commands if number >= tick]


class Sink:
    def __init__(self, log, reach=nothing, name="sink"):
        self.log, self.reach, self.name = log, reach, name
        self.records, self.events = [], []

    def tick(self, record):
        self.reach("sink", record.index)
        self.records.append(record)

    def event(self, text):
        self.events.append(text)

    def close(self):
        self.log.append(f"close {self.name}")

    def modes(self):
        return [record.output.control_mode.mode for record in self.records]


def at(plan, reach=nothing):
    """Intents by tick."""

    def poll(tick):
        reach("source", tick)
        return [plan[tick]] if tick in plan else []

    return poll


TO_STANDBY = {0: Intent.DAMP, 1: Intent.LOAD_A}


def raising(place, first, last=inf, error=BrokenError):
    """Raise where `place` is reached the `first` to `last` time."""

    def reach(where, count):
        if where == place and first <= count <= last:
            raise error

    return reach


def standing(log, reach=nothing, *, plan=TO_STANDBY, sinks=None, duration=0.5, clock=None, **robot):
    """A run that goes to STANDBY and holds the joints there, and its robot and sink."""
    steps = iter(range(10**6))
    machine, sink = Robot(log, reach, **robot), Sink(log, reach)
    run = FakeRun(
        machine,
        sinks=[sink] if sinks is None else [*sinks, sink],
        intents=at(plan, reach),
        on_step=lambda _: reach("step", next(steps)),
        duration=duration,
        clock=clock,
    )
    return run, machine, sink


def is_damping(command):
    """No spring and no torque, and every joint braked."""
    return not command.stiffness.any() and not command.effort.any() and bool((command.damping > 0.0).all())


def check_end(robot, log, since, expected=(REST, REST + 5)):
    """From tick `since` on only finite damping commands, as many as expected; then the robot is closed, then sinks."""
    damped = robot.after(since)
    assert all(command.is_finite() and is_damping(command) for command in damped)
    assert expected[0] <= len(damped) <= expected[1]
    assert log[0] == "activate"
    assert log[1] == "close robot"
    assert set(log[2:]) == {"close sink"}, "closed after the robot"


WAYS = {
    "duration": {"duration": TROUBLE * PERIOD - 0.5 * PERIOD},
    "QUIT": {"plan": {**TO_STANDBY, TROUBLE: Intent.DAMP, TROUBLE + 1: Intent.QUIT}, "duration": 5.0},
}


@pytest.mark.parametrize("way", WAYS)
def test_a_run_that_is_over_damps_until_rest_and_closes_the_robot_before_the_sinks(way):
    log = []
    run, robot, sink = standing(log, **WAYS[way])
    assert run.run().failures == ()
    check_end(robot, log, TROUBLE + 1)
    assert Mode.STANDBY in sink.modes()
    assert sink.records[-1].output.quit


@pytest.mark.parametrize(
    ("signals", "expected"), [({TROUBLE}, (REST, REST + 5)), ({TROUBLE, TROUBLE + 5}, (5, 8))], ids=["one", "two"]
)
def test_a_signal_damps_until_rest_and_a_second_one_does_not_wait_for_it(signals, expected):
    log = []

    def reach(where, count):
        if where == "sink" and count in signals:
            run.stop()

    run, robot, _ = standing(log, reach, duration=None)
    run.run()
    check_end(robot, log, TROUBLE + 1, expected)


def test_two_signals_in_one_tick_end_the_run_at_once_with_damping():
    log = []

    def reach(where, count):
        if (where, count) == ("sink", TROUBLE):
            run.stop("SIGINT")
            run.stop("SIGTERM")

    run, robot, _ = standing(log, reach, duration=None, velocity=lambda _: 1.0)
    run.run()
    check_end(robot, log, TROUBLE + 1, (1, 3))


FAILURES = {
    "the robot cannot be read once": ("read", TROUBLE, TROUBLE),
    "the robot cannot be read any more": ("read", TROUBLE),
    "a command cannot be written once": ("write", TROUBLE, TROUBLE),
    "a source of intents raises": ("source", TROUBLE),
    "the control stack raises": ("step", TROUBLE),
    "Ctrl-C becomes an exception": ("step", TROUBLE, TROUBLE, KeyboardInterrupt),
    "the robot cannot be read in the ending": ("read", 30, 30),
    "a command cannot be written in the ending": ("write", 30, 30),
    "the control stack raises in the ending": ("step", 30),
    "the control stack raises in its very last tick": ("step", 26 + REST),
}


@pytest.mark.parametrize("name", FAILURES)
def test_whatever_raises_the_joints_are_damped_until_rest_without_it(name):
    log = []
    first = FAILURES[name][1]
    run, robot, sink = standing(log, raising(*FAILURES[name]))
    error = KeyboardInterrupt if KeyboardInterrupt in FAILURES[name] else BrokenError
    with pytest.raises(error):
        run.run()
    since = first if first == TROUBLE else 26
    check_end(robot, log, since, (REST, 3 * REST))
    assert any(error.__name__ in text for text in sink.events), "the recording says why"


def test_a_robot_that_takes_no_command_any_more_is_damped_at_every_tick_and_closed():
    log = []
    run, robot, _ = standing(log, raising("write", TROUBLE), velocity=lambda _: 1.0)
    with pytest.raises(BrokenError):
        run.run()
    assert LIMIT <= robot.writes - TROUBLE <= LIMIT + 3
    assert log == ["activate", "close robot", "close sink"]


@pytest.mark.parametrize("breaks", [("read", 0), ("step", 5)])
def test_a_failure_without_torque_brings_none(breaks):
    log = []
    run, robot, _ = standing(log, raising(*breaks), plan={})
    with pytest.raises(BrokenError):
        run.run()
    for command in robot.after(0):
        assert not any(getattr(command, name).any() for name in ("velocity", "effort", "stiffness", "damping"))
    assert log == ["activate", "close robot", "close sink"]


# Rest.


@pytest.mark.parametrize("breaks", [(), ("step", 26)], ids=["supervised", "unsupervised"])
@pytest.mark.parametrize(
    ("motion", "expected"),
    [
        ({"velocity": lambda tick: 0.5 if 26 <= tick < 46 else 0.0}, (20 + REST, 25 + REST)),
        ({"velocity": lambda _: -0.03}, (LIMIT, LIMIT + 3)),
        ({"age": 1.0}, (LIMIT, LIMIT + 3)),
    ],
    ids=["falls for 0.4 s", "never rests", "one joint is silent"],
)
def test_damping_lasts_until_every_joint_rests_and_at_most_three_seconds(motion, expected, breaks):
    log = []
    run, robot, _ = standing(log, raising(*breaks) if breaks else nothing, **motion)
    if breaks:
        with pytest.raises(BrokenError):
            run.run()
    else:
        run.run()
    check_end(robot, log, 26, expected)


# Sinks.


def test_a_sink_that_fails_is_dropped_and_reported_and_the_run_goes_on():
    log = []
    broken = Sink(log, raising("sink", 3))
    run, robot, sink = standing(log, sinks=[broken])
    result = run.run()
    assert [record.index for record in broken.records] == [0, 1, 2]
    assert [record.index for record in sink.records] == list(range(result.ticks)), "the others miss nothing"
    assert sink.modes()[3:26] == [Mode.STANDBY] * 23
    (failure,) = result.failures
    assert "BrokenError" in failure
    assert any("BrokenError" in text for text in sink.events)
    check_end(robot, log, 26)
    assert log.count("close sink") == 2


def test_every_sink_is_closed_whatever_another_ones_close_raises():
    log = []
    sinks = [Sink(log, name="first"), Sink(log, name="last")]
    sinks[1].close = lambda: raising("close", 0)("close", 0)
    run, _, _ = standing(log, sinks=sinks)
    with pytest.raises(BrokenError):
        run.run()
    assert log == ["activate", "close robot", "close sink", "close first"]


# Time.


def stall(clock, place, tick, seconds):
    def reach(where, count):
        if (where, count) == (place, tick):
            clock.sleep(seconds)

    return reach


@pytest.mark.parametrize("place", ["source", "step"])
def test_what_was_decided_before_the_process_stood_still_is_never_sent(place):
    log, clock = [], VirtualClock()
    run, robot, sink = standing(log, stall(clock, place, TROUBLE, 5.0), clock=clock)
    run.run()
    assert not is_damping(dict(robot.commands)[TROUBLE - 1])
    assert sink.modes()[TROUBLE - 1] is Mode.STANDBY
    assert all(is_damping(command) for command in robot.after(TROUBLE)), "and nothing recovers by itself"
    assert sink.modes()[TROUBLE] is Mode.DAMPING
    assert "5.0" in sink.events[0], "the operator learns for how long"


def test_a_standstill_between_two_ticks_damps_in_the_next():
    log, clock = [], VirtualClock()
    run, robot, sink = standing(log, stall(clock, "sink", TROUBLE, 5.0), clock=clock)
    run.run()
    assert sink.modes()[TROUBLE] is Mode.STANDBY
    assert all(is_damping(command) for command in robot.after(TROUBLE + 1))


@pytest.mark.parametrize("place", ["write", "sink"])
def test_a_missed_deadline_is_skipped_and_counted_and_never_caught_up_by_a_burst(place):
    log, clock, starts = [], VirtualClock(), []
    slow = stall(clock, place, 3, 0.05)  # two and a half periods

    def reach(where, count):
        if where == "read":
            starts.append(clock.now - 100.0)
        slow(where, count)

    run, robot, _ = standing(log, reach, plan={}, duration=0.12, clock=clock)
    result = run.run()
    assert starts == pytest.approx([0.0, 0.02, 0.04, 0.06, 0.12, 0.14, 0.16, 0.18], abs=1e-3)
    assert (result.overruns, result.skipped, robot.writes) == (1, 2, 8)
