"""Whatever the doctor would have a user paste is read by the real reader as the contract that it tried."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml
from doctor_examples import FACTS, tracker, walker
from models import contract_of

from humanoid_sim.assets import SAMPLE_POLICY
from humanoid_sim.controllers.contract import PhaseRule
from humanoid_sim.controllers.terms import Term
from humanoid_sim.doctor.examined_policy import robot_facts
from humanoid_sim.doctor.hypotheses import same_contract, singles
from humanoid_sim.doctor.overrides import Pasting, change_lines, overrides, pasting_for
from humanoid_sim.policy.checkpoint import read_contract
from humanoid_sim.policy.contract_json import STAMP_KEY, encode
from humanoid_sim.policy.readers.contract_yaml import parse_contract
from humanoid_sim.policy.readers.merge import merge
from humanoid_sim.policy.readers.sources import metadata_contract
from humanoid_sim.robots.description import load_robot
from humanoid_sim.strict_yaml import read_yaml

PASTING = Pasting(Path("contract.yaml"))


def one_foot():
    """With lists of one number, which must stay lists."""
    joints = FACTS.joint_names
    return contract_of(
        joints,
        action_joint_names=joints[:1],
        joint_stiffness=40.0,
        joint_damping=1.0,
        default_joint_pos=[0.3, 0.1, 0.3, 0.1],
        observation=["projected_gravity", Term("joint_pos", joints=joints[:1], scale=[2.0]), "gait_phase"],
        action_scale=0.5,
        phase=PhaseRule(0.7, offsets=np.array([0.5])),
        position_clip=[[-1.0, 1.0]],
        command_ranges=[[0.0, 0.0]] * 3,
    )


def follows_pose(make):
    """As most dialects have it: no source states the offset of an action."""
    return replace(make(), action_offset=None, provenance={"action_offset": "follows from default_joint_pos"})


CONTRACTS = {
    "walker": walker,
    "tracker": tracker,
    "one foot": one_foot,
    "walker, offset not stated": lambda: follows_pose(walker),
    "tracker, offset not stated": lambda: follows_pose(tracker),
}


def written(present, text):
    """The contract of a checkpoint that is stamped with `present` and has the text as its contract.yaml."""
    stamp = metadata_contract({STAMP_KEY: encode(present)}, "policy.onnx")
    return merge([*stamp, *parse_contract(yaml.safe_load(text), "contract.yaml", "contract.yaml")], "policy.onnx")


@cache
def changed(make):
    """The single edits of a sample contract by their names."""
    return {hypothesis.name: hypothesis.contract for hypothesis in singles(make(), FACTS)}


def tried(contract, facts):
    """Every single edit."""
    for hypothesis in singles(contract, facts):
        yield hypothesis.name, hypothesis.contract


@pytest.mark.parametrize("name", CONTRACTS)
def test_every_hypothesis_can_be_pasted(name):
    contract = CONTRACTS[name]()
    count = 0
    for title, wanted in tried(contract, FACTS):
        text = PASTING.text(contract, wanted)
        assert same_contract(written(contract, text), wanted), f"{title}:\n{text}"
        count += 1
    assert count >= 30


def pasted(path, contract_file, text, folder, joints):
    """The contract after the section of a file has been replaced by the text, with the reader that `play` uses."""
    document = dict(read_yaml(contract_file) or {}) if contract_file.exists() else {}
    document.pop("override", None)
    cured = folder / "cured.yaml"
    rest = yaml.safe_dump(document, sort_keys=False) if document else ""
    cured.write_text(rest + text)
    return read_contract(path, cured, joints)


@pytest.mark.parametrize(
    "override",
    [
        "override:\n  observation: [{name: joint_pos, scale: 0.5}, joint_vel, actions, motion_body_pos_b, "
        "{name: motion_body_ori_b, layout: columns}]\n  action_scale: 0.3\n",
    ],
)
def test_what_a_file_overrides_already_stays(override, tmp_path):
    robot = load_robot("lite")
    file = tmp_path / "contract.yaml"
    file.write_text(override or "{}\n")
    present = read_contract(SAMPLE_POLICY, file, robot.joint_names)
    pasting = pasting_for(SAMPLE_POLICY, file)
    count = 0
    for title, wanted in tried(present, robot_facts(robot, None)):
        text = pasting.text(present, wanted)
        assert same_contract(pasted(SAMPLE_POLICY, file, text, tmp_path, robot.joint_names), wanted), (
            f"{title}:\n{text}"
        )
        assert text.count("override:") == (2 if override else 1)  # in the comment too
        count += 1
    assert count >= 30


def test_an_offset_that_nobody_states_can_be_overridden():
    contract = follows_pose(tracker)
    found = dict(tried(contract, FACTS))
    assert overrides(contract, found["action offset 0"]) == {"action_offset": 0.0}
    moved = overrides(contract, found["default pose all zeros"])
    assert moved == {"default_joint_pos": 0.0, "action_offset": 0.0}


def test_a_clock_of_one_foot_stays_a_list():
    contract = one_foot()
    found = dict(tried(contract, FACTS))
    phase = overrides(contract, found["gait period 0.8 s"])["phase"]
    assert phase["offsets"] == [0.5]
    assert phase["period"] == 0.8


def test_nothing_to_write_for_the_same_contract():
    assert overrides(walker(), walker()) == {}


def test_only_what_differs_is_written():
    contract, flipped, slow = walker(), *map(changed(walker).get, ("projected_gravity sign flipped", "rate 25 Hz"))
    assert overrides(contract, flipped) == {"terms": {"projected_gravity": {"scale": -1.0}}}
    assert overrides(contract, slow) == {"policy_dt": 0.04}
    text = PASTING.text(contract, slow)
    assert text == "# into contract.yaml\noverride: {policy_dt: 0.04}\n"


def test_changes_show_the_value_before_and_after():
    for name, line in (
        ("joint_damping × 2", "joint_damping: [1, 1.1, … 4 in all] → [2, 2.2, … 4 in all]"),
        ("actions scaled", "terms.actions.form: raw → scaled"),
        ("reference not aligned", "align_reference: true → false"),
        ("action scale 0.5", "action_scale: [0.5, 0.6, … 4 in all] → 0.5"),
    ):
        assert change_lines(tracker(), changed(tracker)[name]) == [line]


def test_a_whole_reordering_is_one_line_and_a_default_says_so():
    contract, edits = tracker(), changed(tracker)
    moved = next(name for name in edits if name.startswith("joint order") and name.endswith("values move along"))
    assert change_lines(contract, edits[moved]) == ["all lists per joint reordered"]
    absolute = replace(
        contract, observation=tuple(replace(t, relative=False) if t.name == "joint_pos" else t for t in contract.terms)
    )
    assert change_lines(contract, absolute) == ["terms.joint_pos.relative: true (default) → false"]


def test_what_stays_as_it_is_in_a_section_that_is_written_whole_is_no_change():
    longer = replace(one_foot(), phase=replace(one_foot().phase, period=0.8))
    assert change_lines(one_foot(), longer) == ["phase.period: 0.7 → 0.8"]
