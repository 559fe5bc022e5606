"""The guards: what trips them and when, what does not, what they say; `tests/survive` has that a trip is DAMPING."""

from dataclasses import replace

import numpy as np
import pytest
import rig

from humanoid_sim.controllers.guards import Guards
from humanoid_sim.messages import Intent
from humanoid_sim.mit import COMMAND_FIELDS, MITCommand, MITState
from humanoid_sim.testing.healthy import healthy_state

NAN, INF = np.nan, np.inf
TIMES = [5.0 + 0.02 * i for i in range(30)]


def guards(**changes):
    """Of the rig: limits ±1 rad, 10 N·m, and 5 rad/s."""
    values = {
        "joints": rig.JOINTS,
        "lower": -np.ones(3),
        "upper": np.ones(3),
        "following_effort": np.full(3, 8.0),
        "following_time": 0.1,
        "following_progress": 0.02,
        "limit_margin": np.full(3, 0.2),
        "limit_time": 0.06,
        "speed_limit": np.full(3, 5.0),
        "speed_time": 0.02,
    }
    return Guards(**{**values, **changes})


def command(position=0.0, *, stiffness=50.0, effort=0.0):
    """The elbow is commanded to a position; the others stay at 0."""
    zeros = np.zeros(3)
    wanted, push = np.array([0.0, position, 0.0]), np.array([0.0, effort, 0.0])
    return MITCommand(wanted, zeros, push, np.full(3, stiffness), np.full(3, 2.0))


def state(time, position=0.0, velocity=0.0, age=0.0):
    at, speed = np.array([0.0, position, 0.0]), np.array([0.0, velocity, 0.0])
    return replace(healthy_state(at, time), joint_velocity=speed, joint_age=np.full(3, age))


def trip(watching, positions, sent, **measured):
    """s from the first tick to the one in which a guard trips, and what it says; infinity: none does."""
    memory = None
    for time, position in zip(TIMES, positions, strict=False):
        seen = state(time, position, **measured)
        memory = watching.watch(memory, seen, sent)
        if problems := watching.problems(memory, seen, sent):
            return pytest.approx(time - TIMES[0]), problems[0]
    return INF, ""


@pytest.mark.parametrize(
    ("what", "positions", "sent", "after", "said"),
    [
        ("comes no nearer", [0.3] * 30, command(0.5), 0.1, "following guard: elbow does not follow: it is at 0.30 rad"),
        ("comes nearer by 0.02 rad in 0.1 s", np.linspace(0.0, 0.15, 30), command(0.5), INF, ""),
        ("pulled the other way every 0.08 s", [0.3, 0.3, 0.3, 0.3, -0.3, -0.3, -0.3, -0.3] * 4, command(0.0), INF, ""),
        ("a pause begins the time again", [0.0] * 5 + [0.45] + [0.0] * 5 + [0.45], command(0.5), INF, ""),
        ("pushed back all the time", np.linspace(0.0, -0.2, 30), command(0.5), 0.1, "following guard: elbow"),
        ("pushed out", [1.25] * 30, command(1.25, effort=0.5), 0.06, "limit guard: elbow is at 1.25 rad, 0.25 beyond"),
        ("pushed out", [-1.25] * 30, command(-1.25, effort=-0.5), 0.06, "limit guard: elbow is at -1.25 rad, 0.25 "),
        # As an arm that hangs in its stop with a calibration that is a little off, and is pulled in.
        ("pulled in", [1.3] * 30, command(1.2), INF, ""),
        ("pulled in", [-1.3] * 30, command(-1.2), INF, ""),
        ("within the margin", [1.19] * 30, command(1.3), INF, ""),
        ("within the margin", [-1.19] * 30, command(-1.3), INF, ""),
    ],
)
def test_what_trips_a_guard_and_when(what, positions, sent, after, said):
    found, text = trip(guards(), positions, sent)
    assert found == after
    assert text.startswith(said)


@pytest.mark.parametrize("at", [1.0, 1.1])
def test_legs_at_a_stop_may_be_commanded_further_than_the_joint_goes(at):
    """Beyond its limit a joint does not count as pulled back in, either."""
    assert trip(guards(), [at] * 30, command(5.0))[0] == 0.1, "arms that press there are stopped"
    assert trip(guards(following_within=True), [at] * 30, command(5.0))[0] == INF
    after, text = trip(guards(following_within=True), [0.5] * 30, command(5.0))
    assert after == 0.1, "legs that do not come as far as their limit"
    assert "K_p times the error is 25.0 N·m" in text


def test_a_joint_that_races_trips_the_speed_guard():
    after, text = trip(guards(), [0.0] * 30, command(), velocity=-6.0)
    assert after == 0.02
    assert text == "speed guard: elbow turns at -6.0 rad/s, its limit is 5.0"
    assert trip(guards(speed_time=0.7), [0.0] * 30, command(), velocity=-6.0)[0] == INF


@pytest.mark.parametrize("measured", [{"age": 0.2, "velocity": 9.0}, {"velocity": NAN}])
def test_a_silent_joint_is_not_judged_and_absurd_values_raise_nothing(measured):
    for at in (0.0, NAN, INF, 1e308):
        sent = command(0.5) if "age" in measured else command(0.0, stiffness=0.0)
        assert trip(guards(), [at] * 30, sent, **measured)[0] == INF


def test_a_batch_is_watched_as_each_of_its_robots():
    rng = np.random.default_rng(0)
    watching = guards(following_time=0.03, speed_time=0.01, limit_time=0.02)
    together, apart, trips = None, [None] * 5, 0
    still = np.repeat(rng.normal(size=(5, 1)), 3, axis=1)
    for step in range(40):
        time, velocity = 0.01 * step, 3.0 * rng.normal(size=(5, 3))
        position = still + 0.0004 * rng.normal(size=(5, 3)).cumsum(0)
        wanted = MITCommand(position * 0.5, *np.zeros((2, 5, 3)), np.full((5, 3), 30.0), np.ones((5, 3)))
        upright = np.tile([1.0, 0, 0, 0], (5, 1))
        seen = MITState(time, position, velocity, *np.zeros((2, 5, 3)), upright, *np.zeros((2, 5, 3)))
        together = watching.watch(together, seen, wanted)
        problems = watching.problems(together, seen, wanted)
        for i in range(5):
            alone = replace(healthy_state(position[i], time), joint_velocity=velocity[i])
            one = MITCommand(*(getattr(wanted, name)[i] for name in COMMAND_FIELDS))
            apart[i] = watching.watch(apart[i], alone, one)
            assert watching.problems(apart[i], alone, one).get(0) == problems.get(i)
        trips += len(problems)
    assert trips > 20


def test_nothing_is_watched_where_nothing_pushes():
    run = rig.Run(replace(rig.supervisor(), guards=guards()))
    for intents in ((), (Intent.DAMP,)):
        run.step(*intents)
        for _ in range(20):
            assert not run.step(position=(5.0, -5.0, 5.0)).faults
            assert run.memory.guards is None
