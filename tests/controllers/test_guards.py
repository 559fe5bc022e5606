"""The guards: what trips them and when, what does not, what they say, and that a trip is DAMPING at once."""

from dataclasses import replace

import numpy as np
import pytest
import rig

from humanoid_sim.controllers.guards import Guards
from humanoid_sim.errors import FieldError
from humanoid_sim.messages import Intent
from humanoid_sim.mit import COMMAND_FIELDS, MITCommand, MITState
from humanoid_sim.testing import healthy_state

NAN, INF = np.nan, np.inf
PERIOD = 0.02


def guards(**changes):
    """Of the rig: limits ±1 rad, 10 N·m, and 5 rad/s."""
    values = {
        "joints": rig.JOINTS,
        "lower": -np.ones(3),
        "upper": np.ones(3),
        "effort_limit": np.full(3, 10.0),
        "following_effort": np.full(3, 8.0),
        "following_time": 0.1,
        "following_progress": 0.02,
        "limit_margin": np.full(3, 0.2),
        "limit_time": 0.06,
        "speed_limit": np.full(3, 5.0),
        "speed_time": 0.02,
    }
    return Guards(**{**values, **changes})


def command(position=0.0, *, stiffness=50.0, effort=0.0, joint=1):
    """One joint is asked to be at a position; the others are at 0 and asked to be there."""
    zeros = np.zeros(3)
    wanted, push = zeros.copy(), zeros.copy()
    wanted[joint], push[joint] = position, effort
    return MITCommand(wanted, zeros, push, np.full(3, stiffness), np.full(3, 2.0))


def state(time, position=0.0, velocity=0.0, *, joint=1, age=0.0):
    at, speed = np.zeros(3), np.zeros(3)
    at[joint], speed[joint] = position, velocity
    return replace(healthy_state(at, time), joint_velocity=speed, joint_age=np.full(3, age))


def trip_time(watching, given):
    """s from the first tick to the one in which a guard trips, and what it says; infinity: none does."""
    memory = None
    for seen, sent in given:
        memory = watching.watch(memory, seen, sent)
        if watching.tripped(memory):
            return float(seen.time) - float(given[0][0].time), watching.problem(memory, seen, sent)
        assert watching.problem(memory, seen, sent) == ""
    return INF, ""


def times(count=30):
    return [5.0 + PERIOD * i for i in range(count)]


def test_a_joint_that_comes_no_nearer_trips_the_following_guard():
    blocked = [(state(t, 0.3), command(0.5)) for t in times()]
    after, text = trip_time(guards(), blocked)
    assert after == pytest.approx(0.1)
    assert text == (
        "following guard: elbow does not follow: it is at 0.30 rad, asked to 0.50, and came no nearer for 0.10 s "
        "although K_p times the error is 10.0 N·m, its limit 10; something in the way of elbow, or its direction, "
        "homing offset or zero?"
    )


@pytest.mark.parametrize(
    ("at", "wanted", "cause"),
    [
        (0.95, 0.0, "direction of elbow, or something that holds it?"),
        (-1.0, 0.0, "direction of elbow, or something that holds it?"),
        (0.98, 1.3, "the command is beyond the limits of elbow"),
    ],
)
def test_a_stop_tells_what_is_likely(at, wanted, cause):
    _, text = trip_time(guards(), [(state(t, at), command(wanted)) for t in times()])
    assert text.endswith(cause)


@pytest.mark.parametrize(
    ("name", "positions", "wanted"),
    [
        ("less than 8 N·m", [0.0] * 30, 0.159),
        ("it comes nearer by 0.02 rad in 0.1 s", list(np.linspace(0.0, 0.15, 30)), 0.5),
        ("it is pulled the other way every 0.08 s", [0.3, 0.3, 0.3, 0.3, -0.3, -0.3, -0.3, -0.3] * 4, 0.0),
        ("pushed back, and comes nearer again", [0.0, -0.1, -0.2, -0.17, -0.14, -0.11, -0.08, -0.05, -0.02], 0.5),
        ("a pause begins the time again", [0.0] * 5 + [0.45] + [0.0] * 5 + [0.45], 0.5),
    ],
)
def test_a_joint_that_follows_does_not(name, positions, wanted):
    ticks = [(state(t, at), command(wanted)) for t, at in zip(times(), positions, strict=False)]
    assert trip_time(guards(), ticks) == (INF, "")


@pytest.mark.parametrize("at", [1.0, 1.1])
def test_legs_at_a_stop_may_be_asked_for_more_than_there_is(at):
    """Beyond its limit a joint is not taken to be pulled back in, either."""
    beyond = [(state(t, at), command(5.0)) for t in times()]
    assert trip_time(guards(), beyond)[0] == pytest.approx(0.1), "arms that press there are stopped"
    assert trip_time(guards(following_within=True), beyond) == (INF, "")
    after, text = trip_time(guards(following_within=True), [(state(t, 0.5), command(5.0)) for t in times()])
    assert after == pytest.approx(0.1), "legs that do not come as far as their limit"
    assert "asked to 5.00, and came no nearer for 0.10 s although K_p times the error is 25.0 N·m" in text


def test_a_joint_that_is_pushed_back_all_the_time_trips_it():
    ticks = [(state(t, -0.3 * i * PERIOD), command(0.5)) for i, t in enumerate(times())]
    assert trip_time(guards(), ticks)[0] == pytest.approx(0.1)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_joint_pushed_out_of_its_limits_trips_the_limit_guard(side):
    out = [(state(t, 1.25 * side), command(1.25 * side, effort=0.5 * side)) for t in times()]
    after, text = trip_time(guards(), out)
    assert after == pytest.approx(0.06)
    assert text == (
        f"limit guard: elbow is at {1.25 * side:.2f} rad, 0.25 beyond its limit of {side:.2f}, and pushed outward with "
        "0.5 N·m; the command is beyond it, or is the homing offset of elbow wrong?"
    )


def test_a_joint_out_of_its_limits_that_is_pulled_in_does_not():
    """As an arm that hangs in its stop with a calibration that is a little off, and is walked up from there."""
    assert trip_time(guards(), [(state(t, 1.3), command(1.2)) for t in times()]) == (INF, "")
    assert trip_time(guards(), [(state(t, 1.19), command(1.3)) for t in times()]) == (INF, "")


def test_a_joint_that_races_trips_the_speed_guard():
    after, text = trip_time(guards(), [(state(t, 0.0, -6.0), command()) for t in times()])
    assert after == pytest.approx(0.02)
    assert text.startswith("speed guard: elbow turns at -6.0 rad/s, its limit is 5.0; ")
    assumed = replace(guards(), speed_assumed=("elbow",))
    _, text = trip_time(assumed, [(state(t, 0.0, -6.0), command()) for t in times()])
    assert "its limit is 5.0 (default, not your motor's); a command that jumps" in text
    once = [(state(t, 0.0, 6.0 if i % 2 else 4.0), command()) for i, t in enumerate(times())]
    assert trip_time(guards(), once) == (INF, "")


@pytest.mark.parametrize("joint", range(3))
def test_any_joint(joint):
    ticks = [(state(t, 0.3, joint=joint), command(0.6, joint=joint)) for t in times()]
    assert rig.JOINTS[joint] in trip_time(guards(), ticks)[1]


def test_a_batch_is_watched_as_each_of_its_robots():
    rng = np.random.default_rng(0)
    steps = [(0.01 * i, 0.4 * rng.normal(size=(5, 3)).cumsum(0), 3.0 * rng.normal(size=(5, 3))) for i in range(40)]
    watching = guards(following_time=0.03, speed_time=0.01, limit_time=0.02)
    together = None
    apart = [None] * 5
    trips = 0
    still = np.repeat(rng.normal(size=(5, 1)), 3, axis=1)
    for time, noise, velocity in steps:
        position = still + 0.001 * noise
        wanted = MITCommand(position * 0.5, *np.zeros((2, 5, 3)), np.full((5, 3), 30.0), np.ones((5, 3)))
        seen = MITState(
            time, position, velocity, *np.zeros((2, 5, 3)), np.tile([1.0, 0, 0, 0], (5, 1)), *np.zeros((2, 5, 3))
        )
        together = watching.watch(together, seen, wanted)
        tripped = np.broadcast_to(watching.tripped(together), 5)
        for i in range(5):
            alone = replace(healthy_state(position[i], time), joint_velocity=velocity[i])
            one = MITCommand(*(getattr(wanted, name)[i] for name in COMMAND_FIELDS))
            apart[i] = watching.watch(apart[i], alone, one)
            assert bool(watching.tripped(apart[i])) == bool(tripped[i])
            assert watching.problem(together, seen, wanted, i) == watching.problem(apart[i], alone, one)
        trips += int(tripped.sum())
    assert trips > 20


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lower": np.zeros(2)}, "Guards.lower: is "),
        ({"upper": np.array([1.0, NAN, 1.0])}, "Guards.upper: is "),
        ({"speed_limit": np.array([1.0, 0.0, 1.0])}, "Guards.speed_limit: is "),
        ({"following_time": -0.1}, "Guards.following_time: is -0.1, expected a finite number >= 0"),
        ({"following_progress": 0.0}, "Guards.following_progress: is 0.0, expected a finite number > 0"),
    ],
)
def test_invalid_parameters_are_named(changes, message):
    with pytest.raises(FieldError) as caught:
        guards(**changes)
    assert str(caught.value).startswith(message)


def guarded(**changes):
    return rig.Run(replace(rig.supervisor(), guards=guards(**changes)))


def test_nothing_is_watched_where_nothing_pushes():
    run = guarded()
    for intents in ((), (Intent.DAMP,)):
        run.step(*intents)
        for _ in range(20):
            output = run.step(position=(5.0, -5.0, 5.0))
            assert not output.faults
            assert run.memory.guards is None
