"""What the doctor tells a user to write must, once written, give the very contract that it tried."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import yaml
from examples import FACTS, JOINTS, tracker, walker

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.doctor.hypotheses import pairs, same_contract, singles
from humanoid_sim.doctor.report import override_yaml, overrides, short_lines
from humanoid_sim.policy.contract_json import STAMP_KEY, encode
from humanoid_sim.policy.readers.contract_yaml import parse_contract
from humanoid_sim.policy.readers.merge import merge
from humanoid_sim.policy.readers.sources import metadata_contract


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
