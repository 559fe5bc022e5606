"""The project's own forms of a contract say all of it, bit for bit; and every example of the page is read."""

import re
from dataclasses import replace
from pathlib import Path

import dialects
import numpy as np
import pytest
import yaml
from hypothesis import given
from models import contract

from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.policy.layers import join
from humanoid_sim.policy.readers.own import (
    METADATA_KEYS,
    STAMP_KEY,
    decode,
    encode,
    find_contract,
    read_contract_file,
    read_own,
    read_stamp,
    write_metadata,
)
from humanoid_sim.policy.reading import read_checkpoint

PAGE = Path(__file__).parents[2] / "docs" / "contract.md"
EXAMPLES = re.findall(r"```yaml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


@given(dialects.contracts())
def test_json_keeps_every_bit(made):
    text = encode(made)
    again = decode(text, "here")
    assert encode(again) == text
    assert again.joint_stiffness.tobytes() == made.joint_stiffness.tobytes()
    stated = encode(replace(made, source={}))
    stamped = join(read_stamp({STAMP_KEY: stated, **write_metadata(made)}, "here"), "here").contract
    assert dialects.said(stamped) == dialects.said(made)


@given(dialects.contracts())
def test_the_thirteen_keys_keep_every_bit_of_what_they_hold(made):
    metadata = write_metadata(made)
    assert tuple(metadata) == METADATA_KEYS
    assert len(metadata) == 13
    values = join(read_own(metadata, "here"), "here").values
    for name in ("joint_stiffness", "joint_damping", "default_joint_pos", "action_scale"):
        written = np.broadcast_to(values[name], getattr(made, name).shape)
        assert written.tobytes() == getattr(made, name).tobytes()
    assert values["joint_names"] == made.joint_names
    assert values["lookahead_steps"] == made.lookahead_steps


def test_a_key_that_was_changed_after_stamping_differs():
    made = contract()
    metadata = {**write_metadata(made), STAMP_KEY: encode(made), "joint_stiffness": "50.0,40.0,31.0"}
    (line,) = read_checkpoint(Path("policy.onnx"), metadata).differences
    assert "c 30 against 31" in line


def test_names_that_csv_cannot_keep_are_not_written():
    with pytest.raises(FieldError, match="comma"):
        write_metadata(contract(body_names=("left, right",)))


@given(dialects.contracts())
def test_contract_yaml_says_it_all(tmp_path_factory, made):
    path = tmp_path_factory.mktemp("own") / "contract.yaml"
    path.write_text(dialects.through_yaml(dialects.as_contract_yaml(made)), encoding="utf-8")
    again = join([read_contract_file(path)], "here").contract
    assert dialects.said(again) == dialects.said(made)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("joint_stiffnes: 1", "unknown field 'joint_stiffnes' (did you mean 'joint_stiffness'?)"),
        ("override: {policy_dt: 1}", "every field decides now"),
        ("policy_dt: 0.02\npolicy_dt: 0.04", "'policy_dt' is given twice"),
        ("phase: 3", "phase: is 3, expected a mapping"),
        ("terms: {joint_pos: {scal: 2}}\nobservation: [joint_pos]", "scal"),
        ("observation: [{name: joint_pos, history: long}]", "history"),
        ("- 1", "is a list, expected a mapping"),
        ("source: !!python/name:os.system x", "YAML"),
    ],
)
def test_a_contract_yaml_that_is_wrong_is_one_line(tmp_path, text, message):
    path = tmp_path / "policy.contract.yaml"
    path.write_text(text)
    try:
        refusal = join([read_contract_file(path)], "policy.onnx").problem
    except InputError as error:
        refusal = str(error)
    assert message in refusal
    assert "\n" not in refusal


def test_the_file_of_a_checkpoint_is_found(tmp_path):
    model = tmp_path / "walk.onnx"
    assert find_contract(model) is None
    (tmp_path / "contract.yaml").touch()
    assert find_contract(model) == tmp_path / "contract.yaml"
    (tmp_path / "walk.contract.yaml").touch()
    assert find_contract(model) == tmp_path / "walk.contract.yaml"


def test_there_are_examples_on_the_page():
    assert len(EXAMPLES) >= 3


@pytest.mark.parametrize("text", EXAMPLES)
def test_every_example_of_the_page_is_read(tmp_path, text):
    path = tmp_path / "contract.yaml"
    path.write_text(text)
    document = yaml.safe_load(text)
    joints = document.get("joint_names", ["left_hip", "left_knee"])
    terms = list(dict.fromkeys([*document.get("terms", {}), "joint_pos"]))
    (tmp_path / "base.yaml").write_text(yaml.safe_dump({"joint_names": joints, "observation": terms}))
    assert join([read_contract_file(tmp_path / "base.yaml"), read_contract_file(path)], "policy.onnx").values
