from __future__ import annotations

import io
import json
from collections.abc import Callable
from dataclasses import replace

import pytest
import yaml
from examples import FACTS, JOINTS, tracker, walker
from rich.console import Console

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.doctor.goals import Quality
from humanoid_sim.doctor.hypotheses import Hypothesis, pairs, present, same_contract, singles
from humanoid_sim.doctor.report import (
    conclusion,
    is_healthy,
    override_yaml,
    overrides,
    print_ranking,
    ranking_document,
    short_lines,
)
from humanoid_sim.doctor.search import Ranking, Verdict
from humanoid_sim.doctor.trials import Outcome
from humanoid_sim.policy.contract_json import STAMP_KEY, encode
from humanoid_sim.policy.readers.contract_yaml import parse_contract
from humanoid_sim.policy.readers.merge import merge
from humanoid_sim.policy.readers.sources import metadata_contract

CONTRACT = replace(tracker(), anchor_body="pelvis")
FOUND = {hypothesis.name: hypothesis for hypothesis in singles(CONTRACT, FACTS)}
CURE = "anchor body torso"


def verdict(hypothesis: Hypothesis, up: float, cost: float) -> Verdict:
    outcome = Outcome(up * 4.0, 4.0, Quality({"position": cost}), "" if up == 1.0 else "sank to 0.46 m")
    return Verdict(hypothesis, (outcome,), True)


def ranking(before: tuple[float, float], after: tuple[float, float]) -> Ranking:
    result = Ranking(is_complete=True)
    result.add(verdict(present(CONTRACT), *before))
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
def test_conclusions(before: tuple[float, float], after: tuple[float, float], healthy: bool, text: str) -> None:
    result = ranking(before, after)
    assert is_healthy(result) is healthy
    assert text in conclusion(result)


def test_before_anything_was_tried() -> None:
    assert not is_healthy(Ranking())
    assert conclusion(Ranking()) == "Nothing has been tried yet."
    assert "Nothing has been tried yet." in printed(Ranking())


def printed(result: Ranking, rows: int = 10) -> str:
    stream = io.StringIO()
    print_ranking(Console(file=stream, width=150), result, CONTRACT, rows)
    return stream.getvalue()


def test_the_table_ends_with_what_to_paste() -> None:
    text = printed(ranking((0.3, 2.0), (1.0, 2.0)))
    table, _, rest = text.partition("Most likely")
    for part in (CURE, "as it is", "4.0 of 4 s", "1.2 of 4 s", "sank to 0.46 m", "anchor_body: torso"):
        assert part in table
    pasted = rest[rest.index("override:") :]
    assert yaml.safe_load(pasted) == {"override": {"anchor_body": "torso"}}


def test_nothing_to_paste_where_nothing_helps() -> None:
    assert "override:\n" not in printed(ranking((0.3, 2.0), (0.9, 2.0)))
    assert "override:\n" not in printed(ranking((1.0, 2.0), (0.9, 2.0)))


def test_the_present_contract_is_always_in_the_table() -> None:
    text = printed(ranking((0.05, 2.0), (1.0, 2.0)), rows=1)
    assert "as it is" in text
    assert "rate 25 Hz" not in text


def test_the_document_is_json_and_complete() -> None:
    result = ranking((0.3, 2.0), (1.0, 2.0))
    document = json.loads(json.dumps(ranking_document(result, CONTRACT)))
    assert document["complete"] is True
    assert document["healthy"] is False
    first, second, _ = document["ranking"]
    assert first["rank"] == 1
    assert first["hypothesis"] == CURE
    assert first["causes"] == ["anchor body"]
    assert first["override"] == {"anchor_body": "torso"}
    assert first["trials"] == [{"time_up": 4.0, "seconds": 4.0, "lost": "", "quality": {"position": 2.0}}]
    assert second["hypothesis"] == "as it is"
    assert second["override"] == {}
    assert second["trials"][0]["lost"] == "sank to 0.46 m"


def written(present: PolicyContract, text: str) -> PolicyContract:
    """The contract of a checkpoint that is stamped with `present` and has the text as its contract.yaml."""
    stamp = metadata_contract({STAMP_KEY: encode(present)}, "policy.onnx")
    return merge([*stamp, *parse_contract(yaml.safe_load(text), "contract.yaml", "contract.yaml")], "policy.onnx")


@pytest.mark.parametrize("make", [walker, tracker])
def test_every_hypothesis_can_be_written_down(make: Callable[[], PolicyContract]) -> None:
    contract = make()
    found = [*singles(contract, FACTS), *list(pairs(contract, singles(contract, FACTS)))[::97]]
    for hypothesis in found:
        text = override_yaml(contract, hypothesis.contract)
        assert same_contract(written(contract, text), hypothesis.contract), f"{hypothesis.name}:\n{text}"


def test_nothing_to_write_for_the_same_contract() -> None:
    assert overrides(walker(), walker()) == {}


def test_only_what_differs_is_written() -> None:
    contract = walker()
    changed = {hypothesis.name: hypothesis.contract for hypothesis in singles(contract, FACTS)}
    assert overrides(contract, changed["projected_gravity sign flipped"]) == {
        "terms": {"projected_gravity": {"scale": -1.0}}
    }
    assert overrides(contract, changed["rate 25 Hz"]) == {"policy_dt": 0.04}
    assert override_yaml(contract, changed["rate 25 Hz"]) == "override: {policy_dt: 0.04}\n"


def test_lines_for_a_table_cut_long_lists() -> None:
    contract = tracker()
    changed = {hypothesis.name: hypothesis.contract for hypothesis in singles(contract, FACTS)}
    assert short_lines(contract, changed["joint_damping × 2"]) == ["joint_damping: [2, 2.2, … 4 in all]"]
    assert short_lines(contract, changed["actions scaled"]) == ["terms.actions.form: scaled"]
    assert short_lines(contract, changed["reference not aligned"]) == ["align_reference: false"]
    assert len(JOINTS) == 4
