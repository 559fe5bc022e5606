"""Intents and data from other programs: what is late, what is refused at the edge, and DAMP, which always acts."""

import numpy as np
import pytest
from control_run import JOINTS, PASSIVE_KD, PERIOD, Policy, command, config, state
from control_surface import link

from humanoid_sim.messages import Mode


@pytest.fixture
def session():
    with link(config(), state) as opened:
        yield opened


def go(session, *words):
    """Ask for one after the other, as an operator who waits for each pose."""
    record = session.tick()
    for word in words:
        assert session.send(word)
        record = session.tick()
        for _ in range(4 if word.startswith("load") else 0):
            record = session.tick()
    return record.output


WALK = ("damp", "load_a", "start_locomotion")
REMOTE = ("damp", "load_b", "start_remote")


def test_an_intent_acts_in_the_next_tick(session):
    assert go(session, *WALK).control_mode.mode is Mode.LOCOMOTION
    assert go(session, "damp").control_mode.mode is Mode.DAMPING
    assert go(session, "quit").quit


@pytest.mark.parametrize(("word", "path"), [("load_b", ["damp"]), ("start_remote", REMOTE[:2]), ("quit", ["damp"])])
def test_an_intent_of_more_than_half_a_second_ago_is_refused(session, word, path):
    before = go(session, *path).control_mode
    for _ in range(30):
        session.tick()
    assert session.send(word, age=0.5), "and half a period in the socket"
    output = session.tick().output
    assert (output.control_mode.mode, output.control_mode.controller_name) == (before.mode, before.controller_name)
    assert not output.quit
    said = [*session.refusals, output.control_mode.status_message]
    assert any(f"{word.upper()} refused" in line for line in said)
    assert session.send(word, age=0.48)
    output = session.tick().output
    assert output.quit or output.control_mode.controller_name != before.controller_name


def test_an_intent_from_before_the_latest_damp_is_refused(session):
    go(session, *REMOTE)
    assert session.send("damp")
    session.tick()
    assert session.send("load_a", age=3 * PERIOD), "meant before the DAMP, and later on its way"
    record = session.tick()
    assert record.output.control_mode.mode is Mode.DAMPING
    assert any("LOAD_A refused" in line for line in [*session.refusals, record.output.control_mode.status_message])
    assert go(session, "load_a").control_mode.mode is Mode.STANDBY, "one who saw it may ask at once"


@pytest.mark.parametrize("age", [0.0, 0.6, 3600.0])
def test_damp_is_never_too_late(session, age):
    go(session, *WALK)
    assert session.send("damp", age=age, sender="a stranger")
    assert session.tick().output.control_mode.mode is Mode.DAMPING


@pytest.mark.parametrize("path", [WALK, REMOTE])
def test_damp_under_a_flood_acts_in_that_tick(session, path):
    """The socket of the intents is full, that of the data too, and DAMP is the last that got in."""
    go(session, *path)
    capacity = 0
    while session.send("load_a", sender=f"flood {capacity}"):
        capacity += 1
    assert capacity > 1
    assert session.tick().output.control_mode.mode is not Mode.DAMPING
    for round_ in range(3):
        for i in range(capacity - 1):
            assert session.send("start_remote" if i % 2 else "load_a", sender=f"flood {i}"), "the tick drained it all"
        for _ in range(min(capacity, 10)):
            session.send_velocity(1.0, 0.0, 0.0)
        assert session.send("damp", sender=f"operator {round_}")
        assert session.tick().output.control_mode.mode is Mode.DAMPING


def stiffness(session):
    return session.tick().output.command.stiffness.tolist()


def test_a_remote_command_is_applied_until_it_is_stale(session):
    assert go(session, *REMOTE).command.damping.tolist() == [PASSIVE_KD] * 3
    session.send_remote(JOINTS, command())
    assert [stiffness(session)[0] for _ in range(7)] == [40.0] * 5 + [0.0] * 2


def test_what_waited_on_its_way_is_as_old_as_it_is(session):
    go(session, *REMOTE)
    for _ in range(10):
        session.tick()
    session.send_remote(JOINTS, command(), age=0.06)
    assert [stiffness(session)[0] for _ in range(4)] == [40.0] * 2 + [0.0] * 2
    session.send_remote(JOINTS, command(), age=0.11)
    assert stiffness(session) == [0.0] * 3


@pytest.mark.parametrize(
    ("names", "sent"),
    [
        (("shoulder", "wrist", "elbow"), command()),
        (("shoulder", "elbow"), command(n=2)),
        ((*JOINTS, "neck"), command(n=4)),
        (("left", "right", "head"), command()),
        (JOINTS, command(position=np.array([0.0, np.nan, 0.0]))),
        (JOINTS, command(stiffness=np.array([0.0, np.inf, 0.0]))),
        (JOINTS, command(damping=np.array([0.0, 0.0, -1.0]))),
    ],
    ids=["another order", "a joint is missing", "a joint too many", "other joints", "NaN", "inf", "a negative gain"],
)
def test_a_remote_command_that_does_not_fit_is_refused_at_the_edge(session, names, sent):
    go(session, *REMOTE)
    session.send_remote(JOINTS, command(0.3))
    session.tick()
    session.send_remote(names, sent)
    record = session.tick()
    assert record.input.remote.command.position.tolist() == [0.3] * 3, "it never becomes an input"
    assert record.output.control_mode.mode is Mode.REMOTE
    assert record.output.command.position.tolist() == [0.3] * 3
    assert any("joint" in line or "shoulder" in line or "elbow" in line or "wrist" in line for line in session.refusals)


def test_a_velocity_that_is_not_repeated_is_zero_after_a_quarter_of_a_second():
    policy = Policy()
    with link(config(policy=policy), state) as session:
        go(session, *WALK)
        session.send_velocity(0.5, 0.0, -0.25, age=0.005)
        seen = []
        for _ in range(16):
            session.tick()
            seen.append(policy.seen[-1][-3:].tolist())
        steps = seen[1::2]  # the policy runs in every second tick
        assert steps == [[0.5, 0.0, -0.25]] * 6 + [[0.0, 0.0, 0.0]] * 2
        session.send_velocity(0.25, 0.0, 0.0)
        session.tick()
        session.tick()
        assert policy.seen[-1][-3:].tolist() == [0.25, 0.0, 0.0]
