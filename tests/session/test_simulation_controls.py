"""Pause, speed, push and reset: for a simulation alone, and for nothing that was pressed before or meanwhile."""

import os

import pytest
from fakes import FakeRobot, FakeSink, FakeSource, session

from humanoid_sim.client import Answer, monotonic_ns
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent, Mode
from humanoid_sim.session.intent_socket import IntentSocket
from humanoid_sim.session.simulation_controls import SIMULATION_WORDS, SimulationControls

PAUSED = "refused: the robot's time is paused; resume, look, and ask again"


class Noted(SimulationControls):
    """Of a simulation: what it is made to do is noted."""

    def __init__(self, **options):
        self.noted = []
        noted = dict.fromkeys(("record_push", "stand", "start_over"), self.noted.append)
        super().__init__(self._pushed, bodies=("hand",), **{**noted, **options})

    def _pushed(self, *what):
        if what[2] == "nose":
            raise InputError("unknown body 'nose'")
        self.noted.append(what)


@pytest.fixture
def simulated(local):
    """A session's local end, and its simulation."""
    local.intents.close()
    simulation = Noted()
    path, reactivation = local.registration.intents, local.reactivation
    local.intents = IntentSocket(path, reactivation, local.told.append, simulation=simulation)
    local.stack.callback(local.intents.close)
    local.tick(Intent.DAMP)
    return local, simulation


def ask(local, word, seen=None):
    """What becomes of a request, in a session whose loop goes on or stands."""
    intake = local.intake("operator")
    token = intake.post(word, seen=seen)
    intents = local.intents.poll(local.time, local.output)
    if intents:
        local.tick(*intents)
    return intake.answer(token, 1.0)


@pytest.mark.parametrize("word", SIMULATION_WORDS)
def test_motors_are_offered_none_of_it_emulated_ones_neither(local, word):
    local.tick()
    answer = ask(local, f"{word} 0.5,0" if word == "push" else word)
    why = "it is for a simulation alone; this session drives motors, real or emulated ones"
    assert answer == Answer(False, f"{word.upper()} refused: {why}")
    assert local.told[-1] == f"{answer.text}; requested by operator ({os.getpid()})"
    assert word not in ask(local, "jump").text


REFUSED = {
    "speed 5": "SPEED refused: is '5', expected 0.1 to 4 times real time",
    "speed": "SPEED refused: is '', expected",
    "push 1": "PUSH refused: is '1', expected VX,VY in m/s, and a body",
    "push 1,0 nose": "PUSH refused: unknown body 'nose'",
    "reset": "RESET refused: no start",
}


@pytest.mark.parametrize("word", REFUSED)
def test_what_cannot_be_is_refused_and_changes_nothing(simulated, word):
    local, simulation = simulated
    simulation.problems = {"reset": "no start"}
    answer = ask(local, word)
    assert not answer.granted
    assert answer.text.startswith(REFUSED[word])
    assert (simulation.speed, simulation.takes_reset(), simulation.noted) == (1.0, False, [])


def test_what_was_meant_for_the_robot_of_long_ago_is_refused_but_for_a_pause(simulated):
    local, simulation = simulated
    long_ago = monotonic_ns() - 600_000_000
    for word in ("resume", "speed 2", "push 1,0", "reset"):
        assert "refused: too late" in ask(local, word, long_ago).text
    assert ask(local, "pause", long_ago).granted
    assert simulation.is_paused


@pytest.mark.parametrize("word", ["load_a", "load_b", "start_locomotion", "start_remote", "reactivate", "push 1,0"])
def test_nothing_that_is_pressed_in_a_pause_moves_the_robot_after_it(simulated, word):
    local, simulation = simulated
    assert ask(local, "pause").granted
    assert ask(local, word) == Answer(False, f"{word.partition(' ')[0].upper()} {PAUSED}")
    assert ask(local, "resume").granted
    assert local.tick().input.intents == ()
    assert (simulation.is_paused, local.reactivation.is_asked, simulation.noted) == (False, False, [])


def test_a_pause_stops_the_ticks_and_gives_one_to_damp():
    """Of the loop: LOAD_B of a key is left out, DAMP is decided, and the pause goes on until it is ended."""
    robot, sink, stood = FakeRobot(), FakeSink(), []

    def stand(seconds):
        assert seconds >= 0.02
        stood.append((robot.writes, run.mode))
        simulation.is_paused = len(stood) < 8

    def pause(record):
        simulation.is_paused = simulation.is_paused or record.index == 2

    simulation, sink.on_tick = Noted(stand=stand), pause
    asked = {0: (Intent.DAMP,), 1: (Intent.LOAD_A,), 5: (Intent.LOAD_B,), 7: (Intent.DAMP,)}
    run = session(robot, intents=[FakeSource(asked, finish_at=14)], sinks=[sink], simulation=simulation)
    run.run()
    assert stood == [*[(3, Mode.STANDBY)] * 5, *[(4, Mode.DAMPING)] * 3]
    assert sink.events[0] == f"LOAD_B {PAUSED}"


def test_data_from_outside_ages_by_the_wall_clock_while_the_robots_stands_still(local):
    alive, silent = local.intake("alive"), local.intake("silent")
    alive.velocity(0.2, 0.0, 0.0, deliberate=True)
    silent.live("keys", [1.0, 0.0])
    for age in (0.0, *[0.1] * 6):
        local.data.stand(age)
        assert local.velocity.command.tolist() == [0.2, 0.0, 0.0]
        alive.velocity(0.2, 0.0, 0.0, deliberate=False)
    assert not local.data.latest()["keys"].at(local.time).any()
    for _ in range(3):
        local.data.stand(0.1)
    assert (local.velocity.command.any(), local.data.owners["velocity"]) == (False, "")
