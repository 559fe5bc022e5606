"""`contract.yaml`: what is wrong with it is said with its path."""

import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.policy.contract_json import decode, encode
from humanoid_sim.policy.readers.contract_yaml import find_contract, parse_contract, read_contract_file
from humanoid_sim.policy.readers.merge import merge


def read(path, text):
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_contract_file(path)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(f"{path}: ")
    return message.removeprefix(f"{path}: ")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("policy_dt: fast", "policy_dt: is 'fast', expected a number"),
        ("joint_stiffness: [1, x]", "joint_stiffness[1]: is 'x', expected a number"),
        ("observation: [a, {name: b, scale: big}]", "observation[1].scale: is 'big', expected a number or a list"),
        ("observation: [{scale: 1}]", "observation[0]: misses required field 'name'"),
        ("override: {phase: {period: '1'}}", "override.phase.period: is '1', expected a number"),
        ("terms: {joint_pos: {frame: sideways}}", "terms.joint_pos.frame: is 'sideways', expected one of body, world"),
        ("override: {terms: {joint_pos: {history: 1.5}}}", "override.terms.joint_pos.history: is 1.5, expected a w"),
        ("task_type: dance", "task_type: is 'dance', expected one of tracking, piano, locomotion"),
        ("- policy_dt", "is ['policy_dt'], expected a mapping"),
        ("policy_dt: 0.02\npolicy_dt: 0.04", "line 2, column 1: not valid YAML: 'policy_dt' is given twice"),
        ("policy_dt: [", "line "),
        ("phase: {period: -1}", "phase.period: is -1.0, expected a finite number > 0"),
        ("tensors: {action: 1}", "tensors.action: is 1, expected a text"),
        ("observation: [{name: a, scale: 1}]\nterms: {a: {scale: 1}}", "terms.a.scale: is given in observation as"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_with_its_place(tmp_path, text, message):
    assert read(tmp_path / "contract.yaml", text).startswith(message)


@pytest.mark.parametrize(
    ("text", "place", "some"),
    [
        ("stiffness: 1", "", "joint_stiffness"),
        ("override: {override: {}}", "override: ", "joint_stiffness"),
        ("observation: [{name: a, scalse: 1}]", "observation[0]: ", "history_order"),
        ("terms: {a: {name: b}}", "terms.a: ", "quaternion"),
        ("override: {terms: {a: {name: b}}}", "override.terms.a: ", "quaternion"),
        ("phase: {periode: 1}", "phase: ", "standing_threshold"),
        ("tensors: {obs: x}", "tensors: ", "time_step"),
        ("override: {tensors: {obs: x}}", "override.tensors: ", "time_step"),
        ("command_ranges: {lin_vel_z: [0, 1]}", "command_ranges: ", "ang_vel_z"),
    ],
)
def test_an_unknown_field_is_answered_with_the_known_ones(tmp_path, text, place, some):
    message = read(tmp_path / "contract.yaml", text)
    assert message.startswith(f"{place}unknown field '")
    assert some in message.partition("; known: ")[2].split(", ")


def test_numbers_in_scientific_notation_are_numbers(tmp_path):
    path = tmp_path / "contract.yaml"
    path.write_text("policy_dt: 2e-2\naction_clip: 1E2\ndefault_joint_pos: [1e-3, -2.5e+1, .5]\n")
    (partial,) = read_contract_file(path)
    assert partial.fields["policy_dt"].value == 0.02
    assert partial.fields["action_clip"].value == 100.0
    assert partial.fields["default_joint_pos"].value.tolist() == [0.001, -25.0, 0.5]


def test_python_tags_are_refused(tmp_path):
    message = read(tmp_path / "contract.yaml", "body_names: !!python/object/apply:os.system [ls]")
    assert message.startswith("line 1, column 13: not valid YAML: could not determine a constructor for the tag")


def test_the_file_of_a_checkpoint_is_found(tmp_path):
    model = tmp_path / "walk.onnx"
    assert find_contract(model) is None
    (tmp_path / "contract.yaml").touch()
    assert find_contract(model) == tmp_path / "contract.yaml"
    (tmp_path / "walk.contract.yaml").touch()
    assert find_contract(model) == tmp_path / "walk.contract.yaml"


def test_limits_by_joint_and_in_words():
    document = {
        "joint_names": ["hip", "knee"],
        "joint_stiffness": 20.0,
        "joint_damping": 1.0,
        "default_joint_pos": 0.0,
        "observation": ["joint_pos"],
        "action_scale": 1.0,
        "policy_dt": 0.02,
        "effort_limit": {"knee": 60},
        "action_limit": 440,
        "position_clip": "joint_limits",
    }
    contract = merge(parse_contract(document, "contract.yaml", "contract.yaml"), "policy.onnx")
    assert contract.effort_limit.tolist() == [np.inf, 60.0]
    assert (contract.action_limit, contract.position_clip) == (440.0, "joint_limits")
    again = decode(encode(contract), "here")
    assert again.effort_limit.tolist() == [np.inf, 60.0]
    assert (again.action_limit, again.position_clip) == (440.0, "joint_limits")
    for field, value, message in (
        ("effort_limit", {"toe": 1.0}, r"unknown joint in effort_limit 'toe'; known: hip, knee \(contract\.yaml\)"),
        (
            "effort_limit",
            [1.0, 0.0],
            r"effort_limit: is \[1\.0, 0\.0\], expected a number > 0 for each of 2 joints, or one",
        ),
        ("effort_limit", "strong", r"effort_limit: is 'strong', expected a number or a mapping or a list or null"),
        ("action_limit", 0, r"action_limit: is 0(\.0)?, expected a number > 0"),
        ("position_clip", "limits", r"position_clip: is 'limits', expected "),
    ):
        with pytest.raises(InputError, match=message):
            merge(parse_contract({**document, field: value}, "contract.yaml", "contract.yaml"), "policy.onnx")
