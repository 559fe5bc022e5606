"""The order of verdicts, and which of them is a finding, with outcomes that are made up."""

import pytest
from doctor_examples import tracker

from humanoid_sim.doctor.edits import Edit, set_fields
from humanoid_sim.doctor.hypotheses import Hypothesis
from humanoid_sim.doctor.ranking import Ranking, Verdict
from humanoid_sim.doctor.trials import Outcome


def hypothesis(names, doubt=0.05):
    """Of an edit with a name and a cause; without them the contract as it is."""
    return Hypothesis(Edit(*names, "…", set_fields(), doubt) if names else None, tracker())


def verdict(*names, up=1.0, cost=2.0, doubt=0.05):
    outcome = Outcome(up * 4.0, 4.0, {"all": cost}, "" if up == 1.0 else "tilted")
    return Verdict(hypothesis(names, doubt), outcome)


def ranking(*verdicts):
    result = Ranking()
    for item in verdicts:
        result.add(item)
    return result


def names(result):
    return [item.hypothesis.name for item in result.best()]


def test_time_up_comes_before_quality():
    assert names(ranking(verdict("a", "A", up=0.5, cost=0.1), verdict("b", "B", cost=9.0))) == ["b", "a"]


def test_of_equals_the_simpler_comes_first():
    assert names(ranking(verdict("a", "A", cost=2.0), verdict(cost=2.0))) == ["as it is", "a"]
    assert names(ranking(verdict("a", "A", cost=1.8), verdict(cost=2.0))) == ["a", "as it is"]
    assert names(ranking(verdict("a", "A", cost=1.8, doubt=0.25), verdict(cost=2.0))) == ["as it is", "a"]


def test_below_what_anybody_would_notice_differences_do_not_count():
    assert names(ranking(verdict("a", "A", cost=0.08), verdict(cost=0.1))) == ["as it is", "a"]


def test_of_a_cause_only_the_best_edit_is_ranked():
    result = ranking(verdict("a1", "A", cost=3.0), verdict("a2", "A", cost=2.0), verdict("b", "B", cost=4.0))
    assert names(result) == ["a2", "b"]
    assert [item.hypothesis.name for item in result.alternatives(result.best()[0])] == ["a1"]


def quiet(*names, **parts):
    """Of a run in which the robot stays up, with these parts of its quality."""
    return Verdict(hypothesis(names), Outcome(4.0, 4.0, parts))


@pytest.mark.parametrize(
    ("present", "changed", "is_finding"),
    [
        # Measured: a policy that walks at 0.3 m/s, and with half of each action.
        ({"velocity": 0.05, "tilt": 1.04, "shaking": 0.28}, {"velocity": 0.32, "tilt": 0.67, "shaking": 0.14}, False),
        # It stands still, and with smaller actions a little more upright.
        ({"turning": 0.02, "tilt": 0.22}, {"turning": 0.0, "tilt": 0.01}, False),
        # A published policy that is fed no joint velocities, and with them.
        ({"velocity": 0.69, "tilt": 0.21, "torque": 0.5}, {"velocity": 0.33, "tilt": 0.22, "torque": 0.3}, True),
        ({"velocity": 0.69, "tilt": 0.21, "torque": 0.5}, {"velocity": 0.33, "tilt": 0.27, "torque": 0.2}, False),
        ({"velocity": 0.99, "tilt": 0.1}, {"velocity": 0.50, "tilt": 0.1}, False),
        ({"velocity": 0.99, "tilt": 0.1}, {"velocity": 0.48, "tilt": 0.1}, True),
        # Somebody would notice it as it is: whatever does better counts.
        ({"velocity": 1.11, "tilt": 0.1}, {"velocity": 0.70, "tilt": 0.2}, True),
    ],
)
def test_where_nothing_is_noticeable_a_change_must_be_clearly_better_and_nowhere_worse(present, changed, is_finding):
    result = ranking(quiet(**present), quiet("a", "A", **changed))
    assert names(result) == ["a", "as it is"]
    assert (result.finding is not None) is is_finding
    assert result.is_healthy is not is_finding


def test_a_finding_keeps_the_robot_up_where_the_contract_as_it_is_does_not():
    fallen = ranking(verdict(up=0.5), verdict("a", "A", cost=9.0))
    assert fallen.finding.hypothesis.name == "a"
    assert ranking(verdict(up=0.5), verdict("a", "A", up=0.9)).finding is None
    assert not ranking(verdict(up=0.5), verdict("a", "A", up=0.9)).is_healthy
    assert ranking(verdict(cost=2.0), verdict("a", "A", up=0.9, cost=0.1)).is_healthy


def test_the_second_may_be_the_finding():
    as_it_is = quiet(velocity=0.9, tilt=0.9)
    flatter, right = quiet("a", "A", velocity=0.96, tilt=0.1), quiet("b", "B", velocity=0.3, tilt=0.9)
    found = ranking(as_it_is, flatter, right).finding
    assert found is right
    assert flatter.worsens(as_it_is) == ("velocity",)
    assert right.worsens(as_it_is) == ()
