import io
import json
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from doctor_examples import FACTS, tracker
from rich.console import Console

from humanoid_sim.doctor.hypotheses import Hypothesis, singles
from humanoid_sim.doctor.overrides import Pasting
from humanoid_sim.doctor.ranking import Ranking, Verdict
from humanoid_sim.doctor.report import Examination, conclusion
from humanoid_sim.doctor.trials import Outcome

CONTRACT = replace(tracker(), anchor_body="pelvis")
FOUND = {hypothesis.name: hypothesis for hypothesis in singles(CONTRACT, FACTS)}
CURE = "anchor body torso"
PASTING = Pasting(Path("here") / "contract.yaml")


def verdict(hypothesis, up, cost):
    outcome = Outcome(up * 4.0, 4.0, {"position": cost}, "" if up == 1.0 else "sank to 0.46 m")
    return Verdict(hypothesis, outcome)


def ranking(before, after):
    result = Ranking()
    result.add(verdict(Hypothesis(None, CONTRACT), *before))
    result.add(verdict(FOUND[CURE], *after))
    result.add(
        verdict(FOUND["anchor body left_foot"] if "anchor body left_foot" in FOUND else FOUND["rate 25 Hz"], 0.1, 9.0)
    )
    return result


@pytest.mark.parametrize(
    ("before", "after", "healthy", "text"),
    [
        ((1.0, 2.0), (0.5, 1.0), True, "Nothing wrong found in this space"),
        ((1.0, 2.0), (1.0, 1.99), True, "Nothing wrong found in this space"),
        ((1.0, 2.0), (1.0, 1.8), False, "'anchor body torso' does 10% better, which is little"),
        ((1.0, 2.0), (1.0, 1.0), False, "Most likely: the anchor terms compare torso. With that it does 50% better."),
        ((0.3, 2.0), (1.0, 2.0), False, "Most likely: the anchor terms compare torso. With that it keeps the robot up"),
        ((0.3, 2.0), (0.9, 2.0), False, "Nothing in this space keeps the robot up"),
        ((0.9, 2.0), (0.3, 2.0), False, "Nothing in this space keeps the robot up"),
    ],
)
def test_conclusions(before, after, healthy, text):
    result = ranking(before, after)
    assert result.is_healthy is healthy
    assert text in conclusion(result)


def test_before_anything_was_tried():
    assert not Ranking().is_healthy
    assert conclusion(Ranking()) == "Nothing has been tried yet."
    assert "Nothing has been tried yet." in printed(Ranking())


def printed(result, rows=10):
    stream = io.StringIO()
    Examination(result, CONTRACT, PASTING).print(Console(file=stream, width=150), rows)
    return stream.getvalue()


def test_the_table_ends_with_what_to_paste():
    text = printed(ranking((0.3, 2.0), (1.0, 2.0)))
    table, _, rest = text.partition("Most likely")
    for part in (CURE, "as it is", "4.0 of 4 s", "1.2 of 4 s", "sank to 0.46 m", "anchor_body: pelvis → torso"):
        assert part in table
    pasted = rest[rest.index("# into here/contract.yaml") :]
    assert yaml.safe_load(pasted) == {"override": {"anchor_body": "torso"}}


def test_what_the_trainers_samples_say_comes_before_the_conclusion():
    stream = io.StringIO()
    examination = Examination(ranking((0.3, 2.0), (1.0, 2.0)), CONTRACT, PASTING, samples_problem="sample 3: wrong")
    examination.print(Console(file=stream, width=150), 10)
    assert "samples in the checkpoint contradict the contract. sample 3: wrong\nMost likely" in stream.getvalue()
    assert examination.document()["samples_problem"] == "sample 3: wrong"


def test_nothing_to_paste_where_nothing_helps():
    assert "override:\n" not in printed(ranking((0.3, 2.0), (0.9, 2.0)))
    assert "override:\n" not in printed(ranking((1.0, 2.0), (0.9, 2.0)))


def test_the_present_contract_is_always_in_the_table():
    text = printed(ranking((0.05, 2.0), (1.0, 2.0)), rows=1)
    assert "as it is" in text
    assert "rate 25 Hz" not in text


def test_the_document_is_json_and_complete():
    result = ranking((0.3, 2.0), (1.0, 2.0))
    document = json.loads(json.dumps(Examination(result, CONTRACT, PASTING).document()))
    assert document["complete"] is True
    assert document["healthy"] is False
    first, second, _ = document["ranking"]
    assert first["rank"] == 1
    assert first["hypothesis"] == CURE
    assert first["cause"] == "anchor body"
    assert first["changes"] == ["anchor_body: pelvis → torso"]
    assert first["override"] == {"anchor_body": "torso"}
    assert document["file"] == "here/contract.yaml"
    assert (first["time_up"], first["seconds"], first["parts"]) == (1.0, 4.0, {"position": 2.0})
    assert second["hypothesis"] == "as it is"
    assert second["override"] == {}
    assert second["lost"] == "sank to 0.46 m"


@pytest.mark.parametrize(
    ("after", "text"), [(1.65, "Nothing is certain. 'gains × 2' does 18% better"), (1.8, "Nothing wrong")]
)
def test_what_does_clearly_better_is_named_even_where_it_is_seldom_the_cause(after, text):
    result = Ranking()
    result.add(verdict(Hypothesis(None, CONTRACT), 1.0, 2.0))
    result.add(verdict(FOUND["gains × 2"], 1.0, after))
    assert conclusion(result).startswith(text)


def test_a_healthy_policy_is_not_accused_and_what_else_runs_is_told():
    result = Ranking()
    for hypothesis, parts in (
        (Hypothesis(None, CONTRACT), {"velocity": 0.02, "tilt": 0.98, "shaking": 0.79}),
        (FOUND["action scale × 0.5"], {"velocity": 0.28, "tilt": 0.53, "shaking": 0.45}),
    ):
        result.add(Verdict(hypothesis, Outcome(4.0, 4.0, parts)))
    assert conclusion(result) == (
        "Nothing wrong found in this space: the run as it is shows nothing noticeable. It also runs with 'action scale "
        "× 0.5', 30% better, though worse in velocity; most healthy policies have such a change."
    )
    assert "override:" not in printed(result)
    assert "Most likely" not in printed(result)
    little = Ranking()
    for hypothesis, cost in ((Hypothesis(None, CONTRACT), 0.195), (FOUND["action scale × 0.5"], 0.09)):
        little.add(Verdict(hypothesis, Outcome(4.0, 4.0, {"torque": cost})))
    assert conclusion(little) == "Nothing wrong found in this space: no change does clearly better."


def test_a_wrong_rate_is_found_by_a_quality_that_is_clearly_better():
    wrong = replace(CONTRACT, policy_dt=0.01)
    (cure,) = (h for h in singles(wrong, FACTS) if h.name == "rate 50 Hz")
    result = Ranking()
    result.add(verdict(Hypothesis(None, wrong), 1.0, 2.0))
    result.add(verdict(cure, 1.0, 1.68))
    assert not result.is_healthy
    assert conclusion(result).startswith("Most likely: the policy was trained at 50 Hz. With that it does 16% better")


def test_what_was_not_tried_before_an_interrupt_is_counted():
    result = ranking((0.3, 2.0), (1.0, 2.0))
    result.known = 2
    assert "Not tried" not in conclusion(result)
    result.known = 9
    assert conclusion(result).endswith("Not tried: 7 of 9 changes.")


def test_changes_that_do_as_well_are_named():
    result = ranking((0.3, 2.0), (1.0, 1.0))
    assert result.finding is not None
    assert "As good" not in conclusion(result)
    for cost, named in ((1.04, True), (1.2, False)):
        result.add(verdict(FOUND["rate 25 Hz"], 1.0, cost))
        assert ("which cannot tell them apart: 'rate 25 Hz'." in conclusion(result)) == named
        assert Examination(result, CONTRACT, PASTING).document()["as_good"] == (["rate 25 Hz"] if named else [])


def test_a_change_that_the_trainer_s_samples_contradict_is_no_finding_of_a_robot_that_stays_up():
    result = ranking((1.0, 2.0), (1.0, 1.5))
    assert not result.is_healthy
    result.contradicts = lambda contract: contract.anchor_body == "torso"
    assert result.is_healthy
    assert conclusion(result) == (
        "Nothing wrong found in this space: the wiring agrees with the trainer's samples, which rule out "
        "'anchor body torso', 25% better; small gains like these come from an immature policy."
    )
    result.contradicts = lambda _: False  # such as gains, which samples never show
    assert not result.is_healthy
    fallen = ranking((0.3, 2.0), (1.0, 1.5))
    fallen.contradicts = lambda contract: contract.anchor_body == "torso"
    assert not fallen.is_healthy
