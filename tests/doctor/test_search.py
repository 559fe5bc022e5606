"""The verdict on simulated episodes."""

from dataclasses import replace

import numpy as np
import pytest
from models import contract_of
from plants import term
from rich.console import Console

from humanoid_sim.assets import policy_path
from humanoid_sim.doctor import search
from humanoid_sim.doctor.edits import Edit, single_edits
from humanoid_sim.doctor.search import judge, search_episodes
from humanoid_sim.doctor.trial import Outcome, Simulations, load_subject
from humanoid_sim.robots.description import load_robot

PAIR = contract_of(("left_knee", "right_knee"), joint_stiffness=[40.0, 40.0])
UNEVEN = replace(PAIR, joint_stiffness=np.array([40.0, 80.0]))


def up(errors):
    return Outcome(4.0, {"velocity": errors})


def lost(seconds):
    return Outcome(seconds, {"velocity": 0.1}, "fell")


def edit(name, contract=PAIR):
    return Edit(name, name, contract)


@pytest.mark.parametrize(
    ("present", "tried", "finding", "is_healthy"),
    [
        (up(2.0), [(edit("a"), up(1.9))], None, True),  # some edit suits every healthy policy
        (up(2.0), [(edit("a"), up(1.9)), (edit("b"), up(1.2))], "b", False),
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
    assert "in the long run lost after 7.0 s: fell" in result.note


def test_edits_that_do_as_well_are_named_beside_the_first():
    result = judge(PAIR, lost(1.0), lost(1.0), [(edit("a"), up(1.0)), (edit("b"), up(1.04)), (edit("c"), up(1.2))])
    assert [row.edit.name for row in result.rows] == ["a", "b"]


@pytest.fixture(scope="module")
def walker():
    return load_subject(policy_path("lite_biped_velocity"), load_robot("lite_biped"))


def test_an_episode_can_be_repeated_to_the_bit(walker):
    simulations = Simulations(walker)
    first = simulations.run(walker.contract)
    soft = replace(walker.contract, joint_stiffness=0.1 * walker.contract.joint_stiffness)
    assert simulations.run(soft).lost.startswith("fell")
    assert first.lost == ""
    assert first == simulations.run(walker.contract)


def test_commands_that_a_policy_does_not_answer_are_named(walker):
    deaf = term("velocity_commands", scale=0.0)(walker.contract)
    commands = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -0.5], [0.3, 0.0, 0.0]])
    unanswered = Simulations(walker).run(deaf, commands, 6.0).unanswered
    assert [text.partition(" (")[0] for text in unanswered] == ["yaw rate -0.5", "vx 0.3"]
    assert Simulations(walker).run(walker.contract, commands, 6.0).unanswered == ()


def test_a_contract_that_cannot_run_is_lost_at_once(walker):
    outcome = Simulations(walker).run(term("projected_gravity", history=2)(walker.contract))  # wider than the input
    assert outcome.time_up == 0.0
    assert outcome.lost


def test_a_planted_sign_is_found_in_simulation(walker, monkeypatch):
    wrong = term("projected_gravity", scale=-1.0)(walker.contract)
    few = [edit for edit in single_edits(wrong, walker.description) if edit.family in ("convention", "rate", "gains")]
    monkeypatch.setattr(search, "single_edits", lambda *_: few)
    result = search_episodes(replace(walker, contract=wrong), Console(quiet=True))
    assert result.finding.family == "convention"
