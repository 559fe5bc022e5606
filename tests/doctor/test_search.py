"""The verdict on simulated episodes."""

from dataclasses import replace

import numpy as np
import pytest
from models import contract_of
from plants import term, turned
from rich.console import Console

from humanoid_sim.assets import policy_path
from humanoid_sim.doctor import search
from humanoid_sim.doctor.edits import Edit, single_edits
from humanoid_sim.doctor.search import judge, search_episodes
from humanoid_sim.doctor.trial import episode_errors, load_subject, run_episode
from humanoid_sim.regress.results import Episode
from humanoid_sim.robots.description import load_robot

PAIR = contract_of(("left_knee", "right_knee"), joint_stiffness=[40.0, 40.0])
UNEVEN = replace(PAIR, joint_stiffness=np.array([40.0, 80.0]))


def up(error):
    return Episode(case="", seed=0, steps=200, duration=4.0, metrics={"yaw_rate_error": error, "survival": 1.0})


def lost(seconds):
    return Episode(case="", seed=0, steps=1, duration=seconds, failure="fell", kind="lost", metrics={})


def edit(name, contract=PAIR):
    return Edit(name, name, contract)


@pytest.mark.parametrize(
    ("present", "tried", "finding", "is_healthy"),
    [
        (up(2.0), [(edit("a"), up(1.9))], None, True),  # some edit suits every healthy policy
        (up(2.0), [(edit("a"), up(1.9)), (edit("b"), up(1.2))], "b", False),
        (up(0.2), [(edit("a"), up(0.1))], None, True),  # nobody would notice
        (up(2.0), [(edit("a"), lost(3.9))], None, True),
        (up(2.0), [(edit("a", UNEVEN), up(1.5))], None, True),  # gains that differ between the sides
        (lost(3.9), [(edit("a"), lost(3.95)), (edit("b"), up(9.0))], "b", False),
        (lost(3.9), [(edit("a"), lost(3.95))], None, False),
        (lost(1.0), [(edit("rate"), up(1.1)), (edit("b"), up(1.2))], "b", False),  # a rate is rarely wrong
        (lost(1.0), [(edit("a", UNEVEN), up(1.0)), (edit("b"), up(1.2))], "b", False),
    ],
)
def test_an_edit_is_a_finding_where_it_keeps_the_robot_up_or_saves_much(present, tried, finding, is_healthy):
    result = judge(PAIR, present, up(2.0), tried)
    assert (result.finding and result.finding.name) == finding
    assert result.is_healthy is is_healthy


def test_a_robot_that_is_lost_in_the_long_run_is_not_healthy():
    result = judge(PAIR, up(2.0), lost(7.0), [(edit("a"), up(1.9))])
    assert (result.finding, result.is_healthy) == (None, False)
    assert "in a longer episode lost after 7.0 s: fell" in result.note


def test_a_command_that_is_not_answered_is_named():
    metrics = {"yaw_rate_error": 0.2, "vx_reached": 0.9, "vy_reached": None, "yaw_rate_reached": 0.1}
    long = Episode(case="", seed=0, steps=1000, duration=20.0, metrics=metrics)
    result = judge(PAIR, up(0.2), long, [])
    assert result.is_healthy
    assert "does not answer the command (yaw_rate_reached 10%)" in result.note
    assert "vx" not in result.note


def test_edits_that_do_as_well_are_named_beside_the_first():
    result = judge(PAIR, lost(1.0), lost(1.0), [(edit("a"), up(1.0)), (edit("b"), up(1.04)), (edit("c"), up(1.2))])
    assert [row.edit.name for row in result.rows] == ["a", "b"]


@pytest.fixture(scope="module")
def walker():
    return load_subject(policy_path("lite_biped_velocity"), load_robot("lite_biped"))


def test_what_follows_a_motion_is_judged_by_it():
    arms = load_subject(policy_path("lite_tracking"), load_robot("lite"), motion="wave")
    right = run_episode(arms, 1.0)
    wrong = run_episode(arms.under(turned("left_elbow_pitch")(arms.contract)), 1.0)
    assert right.failure == ""
    assert wrong.failure or sum(episode_errors(wrong).values()) > 1.5 * sum(episode_errors(right).values())


def test_a_contract_that_cannot_run_has_failed_at_once(walker):
    wider = walker.under(term("projected_gravity", history=2)(walker.contract))  # than the model's input
    episode = run_episode(wider, 2.0)
    assert (episode.duration, episode.kind) == (0.0, "fault")


def test_a_planted_sign_is_found_in_simulation(walker, monkeypatch):
    wrong = term("projected_gravity", scale=-1.0)(walker.contract)
    few = [edit for edit in single_edits(wrong, walker.description) if edit.family in ("convention", "rate", "gains")]
    monkeypatch.setattr(search, "single_edits", lambda *_: few)
    result = search_episodes(walker.under(wrong), Console(quiet=True))
    assert result.finding.family == "convention"
