"""Whole songs on the simulated piano, by a policy and open loop."""

import numpy as np
import pytest

from humanoid_sim.envs.scenario import make_scenario
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.piano_run import PlayedSong, play_with_policy
from humanoid_sim.evaluation.piano_score import PianoScore, Ratio
from humanoid_sim.policy.motion import Motion
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.keys import Touch

ROBOT = load_robot("lite_piano")
TABLE = np.zeros((130, 88), dtype=np.float32)
TABLE[60:90, 30] = TABLE[75:110, 57] = 1.0


def check(played):
    assert (played.score.note_count, played.score.hit_count, played.score.false_count) == (2, 2, 0)
    assert played.touch.key in (30, 57)
    assert played.contacts == ()
    assert played.problems(14.0) == ()
    assert played.figures == (
        played.score.steps.precision,
        played.score.steps.recall,
        played.score.steps.f1,
        played.touch.force,
    )


def test_the_sample_policy_plays_two_notes():
    motion = Motion(TABLE, (), 0.02, task_type="piano", robot="lite_piano")
    scenario = make_scenario("lite_piano", ROBOT, motion, actuation="implicit")
    check(play_with_policy(scenario.description, scenario.wiring, scenario.policy, TABLE, "implicit"))


def test_a_policy_that_answers_nonsense_is_one_line():
    motion = Motion(TABLE, (), 0.02, task_type="piano", robot="lite_piano")
    scenario = make_scenario("lite_piano", ROBOT, motion, actuation="implicit")
    with pytest.raises(InputError, match=r"^policy: at 0\.00 s of the song: "):
        play_with_policy(
            scenario.description, scenario.wiring, lambda *_: np.full(14, np.nan, dtype=np.float32), TABLE, "implicit"
        )


def test_problems_are_named():
    score = PianoScore(Ratio(1.0, 1.0, 1.0), Ratio(1.0, 1.0, 1.0), 0, 0, 0)
    played = PlayedSong(score, Touch(14.5, 39, 1.0), ("left_hand and right_hand",))
    assert played.problems(14.0) == (
        "C4 was touched with 14.5 N, the limit is 14 N",
        "left_hand and right_hand touched",
    )
    assert played.problems(15.0) == ("left_hand and right_hand touched",)
    assert PlayedSong(score, None, ()).figures == (1.0, 1.0, 1.0, 0.0)
