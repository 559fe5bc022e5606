"""The order of the search, with trials whose outcomes are made up."""

import math
from dataclasses import replace

import numpy as np
import pytest
from doctor_examples import FACTS, tracker, walker
from mistakes import turned_round

from humanoid_sim.doctor import search as module
from humanoid_sim.doctor.edits import set_fields
from humanoid_sim.doctor.hypotheses import _contract_key as contract_key
from humanoid_sim.doctor.hypotheses import same_contract, singles, spared
from humanoid_sim.doctor.ranking import Ranking, Verdict
from humanoid_sim.doctor.search import make_plan, search
from humanoid_sim.doctor.trials import Outcome


def names(result):
    return [item.hypothesis.name for item in result.best()]


def test_a_plan_walks_with_commands_that_the_policy_knows():
    plan = make_plan(walker(), seconds=2.0)
    trials = [*plan.brief, *plan.thorough]
    ranges = walker().command_ranges
    commands = np.array([trial.command for trial in trials])
    assert ((ranges[:, 0] <= commands) & (commands <= ranges[:, 1])).all()
    assert len({trial.command for trial in plan.thorough}) == 3
    assert all(abs(trial.yaw) >= 1.0 for trial in trials)  # where world and body frames differ
    given = make_plan(walker(), command=(0.3, 0.0, 0.1))
    assert {trial.command for trial in (*given.brief, *given.thorough)} == {(0.3, 0.0, 0.1)}


def test_a_plan_is_no_longer_than_the_motion():
    plan = make_plan(tracker(), seconds=4.0, motion_seconds=6.0)
    assert [trial.seconds for trial in plan.brief] == [4.0]
    assert {trial.seconds for trial in plan.thorough} == {6.0}
    assert make_plan(tracker(), seconds=4.0, motion_seconds=3.0).brief[0].seconds == 3.0
    assert make_plan(tracker(), seconds=4.0, motion_seconds=900.0).thorough[0].seconds == 20.0


class Invented:
    """In the place of `TrialRunner`: outcomes by a rule, and a count."""

    def __init__(self, judge):
        self._judge = judge
        self.seconds = []

    def __call__(self, examined):
        return self

    def run(self, contract, trial, until=math.inf):
        self.seconds.append(trial.seconds)
        up, cost = self._judge(contract)
        return Outcome(up * trial.seconds, trial.seconds, {"all": cost}, "" if up == 1.0 else "fell")


class Patient:
    def __init__(self, contract):
        self.contract = contract


@pytest.fixture
def examine(monkeypatch):
    def run(contract, judge, pairs=2000):
        monkeypatch.setattr(module, "TrialRunner", Invented(judge))
        result = Ranking()
        stages = []

        def progress(stage, done, total):
            assert 0 <= done <= total
            stages.append(stage)

        plan = make_plan(contract, motion_seconds=10.0, pairs=pairs)
        search(Patient(contract), FACTS, plan, result, progress)
        assert stages[0] == "single changes"
        return result

    return run


def by_contract(*judgements):
    """A judge that knows some contracts; each judgement is a share of the time up, and a cost."""
    known = {contract_key(contract): judgement for contract, judgement in judgements}
    return lambda contract: known.get(contract_key(contract), (0.2, 5.0))


def right_only(right):
    return by_contract((right, (1.0, 1.0)))


def two_mistakes():
    """The right contract, the wrong one, either cure alone, and what changes nothing but the stiffness."""
    right = tracker()
    wrong = set_fields(anchor_body="pelvis", align_reference=False)(right)
    halves = (set_fields(anchor_body="torso")(wrong), set_fields(align_reference=True)(wrong))
    return right, wrong, halves, set_fields(joint_stiffness=0.5 * wrong.joint_stiffness)(wrong)


def test_one_mistake_is_found(examine):
    right = tracker()
    wrong = set_fields(anchor_body="pelvis")(right)
    result = examine(wrong, right_only(right))
    assert names(result)[0] == "anchor body torso"
    assert result.is_complete
    assert result.present.is_thorough


def test_two_mistakes_are_found_though_neither_cure_helps_alone(examine):
    right, wrong, *_ = two_mistakes()
    assert names(examine(wrong, right_only(right)))[0] == "anchor body torso + reference aligned"
    assert "+" not in names(examine(wrong, right_only(right), pairs=0))[0]


def test_a_right_contract_is_left_alone_without_trying_pairs(examine):
    result = examine(tracker(), right_only(tracker()))
    assert names(result)[0] == "as it is"
    assert all(len(item.hypothesis.edits) < 2 for item in result.verdicts.values())


def test_whatever_is_known_survives_an_interruption(monkeypatch, examine):
    contract = tracker()
    monkeypatch.setattr(module, "TrialRunner", Invented(right_only(contract)))
    result = Ranking()

    def interrupt(stage, done, total):
        if done == 10:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        search(Patient(contract), FACTS, make_plan(contract, motion_seconds=9.0), result, interrupt)
    assert len(result.verdicts) == 11  # with the contract as it is
    assert result.singles_tried == 10
    assert not result.is_complete
    assert names(result)[0] == "as it is"


def test_close_edits_of_one_cause_are_all_tried_at_length(examine):
    contract = tracker()
    scales = {"action scale 1": 2.0, "action scale 0.5": 2.1, "action scale 0.25": 9.0}
    found = {h.name: h.contract for h in singles(contract, FACTS) if h.name in scales}
    judge = by_contract(*((made, (1.0, scales[name])) for name, made in found.items()))
    thorough = {name for name, item in examine(contract, judge).verdicts.items() if item.is_thorough}
    assert {"action scale 1", "action scale 0.5"} <= thorough
    assert "action scale 0.25" not in thorough


def test_two_mistakes_are_found_though_a_third_change_keeps_the_robot_up(examine):
    """By chance: it falls over no more, but does nothing right. Each cure alone only delays the fall."""
    right, wrong, halves, softer = two_mistakes()
    judge = by_contract((right, (1.0, 1.0)), (softer, (1.0, 4.0)), *((half, (0.6, 5.0)) for half in halves))
    assert names(examine(wrong, judge))[0] == "anchor body torso + reference aligned"


def test_two_mistakes_are_found_though_either_cure_alone_is_worse_and_a_third_change_keeps_the_robot_up(examine):
    """No other change is as bad as either cure."""
    right, wrong, halves, softer = two_mistakes()
    judge = by_contract((right, (1.0, 1.0)), (softer, (1.0, 4.0)), *((half, (0.1, 9.0)) for half in halves))
    result = examine(wrong, judge, pairs=6000)
    assert names(result)[0] == "anchor body torso + reference aligned"
    assert result.pairs_tried == result.pairs_known > 1000


def test_where_one_change_leaves_nothing_to_notice_few_pairs_are_tried(examine):
    right = tracker()
    result = examine(set_fields(anchor_body="pelvis")(right), right_only(right))
    assert 50 < result.pairs_known <= 200


def test_a_right_value_is_not_altered_along_with_a_wrong_one(examine):
    wrong = replace(tracker(), observation=["command", "base_ang_vel", "joint_pos", "joint_vel"])
    found = {h.name: h for h in singles(wrong, FACTS)}
    coarse = found["observation scales of legged_gym (ang vel 0.25, joint vel 0.05)"]
    (right,) = (h for h in spared(wrong, coarse) if "but not terms.joint_vel" in h.name)

    def judge(is_part_better):
        return by_contract((coarse.contract, (1.0, 3.0)), (right.contract, (1.0, 2.0 if is_part_better else 9.0)))

    single = "base_ang_vel scaled by 0.25"  # the same contract, found by itself
    assert names(examine(wrong, judge(is_part_better=True), pairs=0))[0] in (right.name, single)
    assert names(examine(wrong, judge(is_part_better=False), pairs=0))[0] == coarse.name


def test_parts_that_make_no_difference_stay_as_they_are():
    wrong = replace(tracker(), observation=["command", "base_ang_vel", "joint_pos", "joint_vel"])
    (coarse,) = (h for h in singles(wrong, FACTS) if h.name.startswith("observation scales of legged_gym (ang"))
    smaller = {h.name: h for h in spared(wrong, coarse)}
    assert set(smaller) == {
        f"{coarse.name}, but not terms.base_ang_vel.scale",
        f"{coarse.name}, but not terms.joint_vel.scale",
    }
    less = smaller[f"{coarse.name}, but not terms.joint_vel.scale"]
    assert [float(np.asarray(term.scale)) for term in less.contract.terms] == [1.0, 0.25, 1.0, 1.0]
    assert less.explanation.endswith("; but terms.joint_vel.scale is right as it is")
    assert less.causes == coarse.causes
    assert same_contract(less.edits[0].change(wrong), less.contract)
    # As good as the coarse one: the smaller change comes first.
    result = Ranking()
    for hypothesis in (coarse, less):
        result.add(Verdict(hypothesis, (Outcome(4.0, 4.0, {"all": 2.0}),), True))
    assert names(result) == [less.name]
    orders = [h for h in singles(wrong, FACTS) if h.causes == ("joint order",)]
    assert len(orders) >= 2
    assert all(not list(spared(wrong, h)) for h in orders)  # names and values go together


class Clocked(Invented):
    """In which a simulated second takes so many s of a clock, and a trial is broken off when its time is over."""

    def __init__(self, monkeypatch, pace, judge):
        super().__init__(judge)
        self.now = 0.0
        self._pace = pace
        monkeypatch.setattr(module.time, "perf_counter", lambda: self.now)
        monkeypatch.setattr(module, "TrialRunner", self)

    def run(self, contract, trial, until=math.inf):
        outcome = super().run(contract, trial)
        over = self.now + self._pace * outcome.time_up > until
        self.now = max(self.now, until) if over else self.now + self._pace * outcome.time_up
        return None if over else outcome


@pytest.mark.parametrize("pace", [0.2, 2.0, 20.0])
def test_a_search_ends_with_its_budget_and_says_what_was_not_tried(pace, monkeypatch):
    right, wrong, *_ = two_mistakes()
    clock = Clocked(monkeypatch, pace, right_only(right))
    result = Ranking()
    told = []
    plan = make_plan(wrong, motion_seconds=9.0, budget=60.0)
    search(Patient(wrong), FACTS, plan, result, lambda *known: told.append(known))
    assert clock.now == result.seconds <= 60.0
    assert result.is_complete
    assert result.singles_known == len(singles(wrong, FACTS))
    stages = dict.fromkeys(stage for stage, _, _ in told)
    assert next(iter(stages)) == "single changes"
    assert result.pairs_tried > 0
    if pace == 0.2:
        assert result.singles_tried == result.singles_known
        assert names(result)[0] == "anchor body torso + reference aligned"
    else:
        assert f"{result.pairs_known - result.pairs_tried} of {result.pairs_known} pairs of changes" in result.untried
    if pace == 20.0:
        assert result.singles_tried < result.singles_known
        assert f"{result.singles_known - result.singles_tried} of {result.singles_known} single" in result.untried


def test_no_trial_is_cut_where_there_is_time(monkeypatch):
    Clocked(monkeypatch, 0.01, lambda _: (1.0, 1.0))
    result = Ranking()
    plan = make_plan(tracker(), motion_seconds=9.0, budget=60.0)
    search(Patient(tracker()), FACTS, plan, result, lambda *_: None)
    assert result.untried == ""
    assert {outcome.seconds for item in result.verdicts.values() for outcome in item.outcomes} == {4.0, 9.0}


def test_a_joint_is_tried_at_a_glance_first(examine):
    right = tracker()
    wrong = turned_round("left_knee")(right)
    result = examine(wrong, right_only(right))
    assert names(result)[0] == "left_knee turned round"
    assert result.singles_tried == result.singles_known


def test_pairs_are_tried_until_past_the_fall_of_nearly_all_single_changes(monkeypatch):
    contract = tracker()
    present = contract_key(contract)
    trials = Invented(lambda tried: (0.1 if contract_key(tried) == present else 0.4, 5.0))
    monkeypatch.setattr(module, "TrialRunner", trials)
    plan = make_plan(contract, motion_seconds=9.0, pairs=500)
    search(Patient(contract), FACTS, plan, Ranking(), lambda *_: None)
    glances = [seconds for seconds in trials.seconds if seconds < 4.0]
    assert glances.count(pytest.approx(1.3 * 0.4 * 4.0)) >= 500
