from dataclasses import replace

import numpy as np
import pytest

from humanoid_sim.messages import (
    Event,
    EventKind,
    Intent,
    RemoteCommand,
    SafetyLevel,
    SafetyStatus,
    TickInput,
    TickRecord,
)
from humanoid_sim.mit import VELOCITY_COMMAND, Extern, MITCommand, MITState
from humanoid_sim.session.recorded_inputs import RecordedInputs
from humanoid_sim.session.sources import RemoteInbox, VelocityCommand

PERIOD = 0.1


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


def tick(index, *intents, source="mujoco"):
    live = {VELOCITY_COMMAND: Extern(np.full(3, float(index)), 0.0), "own": Extern(np.zeros(1), 0.0)}
    state = replace(MITState.unknown(1, PERIOD * index), extern=live)
    level = SafetyLevel.OK if source == "mujoco" else SafetyLevel.FAULT
    remote = RemoteCommand(MITCommand.zeros(1), PERIOD * index)
    return TickRecord(index, TickInput(state, (SafetyStatus(level, source=source),), intents, remote), None, 0.0, False)


def inputs(clock, entries, **options):
    return RecordedInputs(iter(entries), PERIOD, clock, measured=("own",), **options)


def test_every_tick_gets_its_own_intents_once(clock):
    recorded = inputs(clock, [tick(0, Intent.DAMP), tick(1), tick(2, Intent.LOAD_A, Intent.DAMP)])
    polled = []
    for now in (0.0, 0.0, 0.1, 0.2, 0.3):
        clock.now = now
        polled.append(recorded.poll(now, None))
    assert polled == [(Intent.DAMP,), (), (), (Intent.LOAD_A, Intent.DAMP), ()]


def test_a_clock_that_is_a_little_off_finds_the_same_tick(clock):
    recorded = inputs(clock, [tick(0), tick(1)])
    for now, value in ((0.04, 0.0), (0.06, 1.0)):
        clock.now = now
        assert recorded.latest()[VELOCITY_COMMAND].value[0] == value


def test_a_velocity_that_somebody_sets_takes_the_recorded_ones_place(clock):
    recorded = inputs(clock, [tick(0)])
    assert list(recorded.latest()) == [VELOCITY_COMMAND], "what the robot reports itself is left to it"
    recorded.velocity = VelocityCommand(np.zeros(3))
    assert VELOCITY_COMMAND in recorded.latest()
    recorded.velocity.press("w")
    assert recorded.latest() == {}


@pytest.mark.parametrize(
    "end",
    [
        (),
        (Event(0.1, "ending", EventKind.ENDING), tick(2), tick(3)),
        (Event(0.1, "reactivated", EventKind.FRESH_START), tick(2)),
    ],
)
def test_it_ends_with_the_recording_where_the_run_was_about_to_end_and_where_it_began_afresh(clock, end):
    recorded = inputs(clock, [tick(0), tick(1), *end])
    ends = []
    for now in (0.0, 0.1):
        clock.now = now
        recorded.poll(now, None)
        ends.append(recorded.finished)
    assert ends == [False, True]


def test_an_operator_ends_the_intents_but_not_the_data(clock):
    recorded = inputs(clock, [tick(0, Intent.LOAD_A), tick(1, Intent.START_LOCOMOTION)])
    recorded.cancel()
    clock.now = 0.1
    assert recorded.poll(0.1, None) == ()
    assert recorded.latest()[VELOCITY_COMMAND].value[0] == 1.0


def test_remote_commands_are_the_recorded_ones_until_another_arrives(clock):
    inbox = RemoteInbox(("a",), clock)
    source = inputs(clock, [tick(0), tick(1)]).remote(inbox)
    clock.now = 0.1
    assert source.latest().arrival_time == 0.1
    inbox.put(("a",), MITCommand.zeros(1), 0.07)
    assert source.latest().arrival_time == 0.07


def test_safety_of_other_sources_is_repeated_while_it_lasts(clock):
    own = (SafetyStatus(source="mujoco"),)
    entries = [tick(0, source="other")]
    recorded = inputs(clock, entries)
    assert [status.source for status in recorded.safety(own)] == ["mujoco", "other"]
    clock.now = 1.0
    assert recorded.safety(own) == own
    clock.now = 0.0
    assert inputs(clock, entries, repeats_safety=False).safety(own) == own
