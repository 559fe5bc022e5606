"""The project's own forms of a contract say all of it, bit for bit; and every example of the page is read."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trainer
import yaml
from models import contract

from humanoid_sim.controllers.contract import HeightScan, PhaseRule, TensorNames, Term
from humanoid_sim.errors import InputError
from humanoid_sim.policy.layers import join
from humanoid_sim.policy.readers.mjlab import read_csv
from humanoid_sim.policy.readers.own import (
    METADATA_KEYS,
    STAMP_KEY,
    decode,
    encode,
    find_contract,
    read_contract_file,
    read_stamp,
    write_metadata,
)

HERE = Path("policy.onnx")
PAGE = Path(__file__).parents[2] / "docs" / "contract.md"
EXAMPLES = re.findall(r"```yaml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
THIRD = 1.0 / 3.0
UNUSUAL = contract(
    task_type="tracking",
    joint_stiffness=[THIRD, 1e-300, 5e300],
    default_joint_pos=[-0.0, np.pi, -1e-17],
    observation=[
        Term("odd name.x", "joint_pos", [THIRD, 2.0, 0.0], (-THIRD, 2.0), history=2, history_order="newest_first"),
        Term("v", "base_lin_vel", frame="world", at="imu", history=2),
        Term("o", "motion_anchor_ori", layout="two_rows", inverse=True, history=2),
        Term("q", "imu_quaternion", quaternion="xyzw", history=2),
        Term("joint_vel", joints=("c", "a"), history=2),
        Term("motion_command", relative=True, history=2),
        Term("actions", form="scaled", history=2),
        Term("height_scan", scan=HeightScan("head", (0.4, 0.2), 0.2, 0.1, 3.0), history=2),
        Term("mood", width=2, timeout=np.inf, history=2),
    ],
    command_names=("motion",),
    body_names=("pelvis", "head"),
    dataset_repo_id="user/name",
    lookahead_steps=(1, 5),
    action_offset=[THIRD, -THIRD],
    action_clip=12.5,
    action_limit=1e4,
    position_clip=[[-1.0, THIRD], [-2.0, 2.0]],
    effort_limit=[1.0, np.inf, THIRD],
    model_joint_damping="drop",
    history_layout="per_step",
    command_ranges=[[-1, THIRD], [0, 0], [-2, 2]],
    phase=PhaseRule(THIRD, offsets=[0.5], standing_value=None),
    anchor_body="pelvis",
    align_reference=False,
    reference_quaternion="xyzw",
    tensors=TensorNames("obs", "act", "step"),
    source={"policy_dt": "deploy.yaml", "observation.v.at": "assumed (mjlab)"},
)
CONTRACTS = [contract(), trainer.contract(), UNUSUAL]


def stated(made):
    return json.loads(encode(made))["contract"]


def test_fields_of_older_stamps_that_mean_nothing_any_more_are_ignored():
    older = json.loads(encode(UNUSUAL))
    older["contract"]["observation"][0]["topic"] = "/odd"
    assert encode(decode(json.dumps(older), "here")) == encode(UNUSUAL)


@pytest.mark.parametrize("made", CONTRACTS)
def test_each_form_keeps_every_bit_of_what_it_holds(tmp_path, made):
    again = decode(encode(made), "here")
    assert encode(again) == encode(made)
    assert again.joint_stiffness.tobytes() == made.joint_stiffness.tobytes()
    metadata = write_metadata(made)
    assert (tuple(metadata), len(metadata)) == (METADATA_KEYS, 13)
    stamp = {STAMP_KEY: encode(replace(made, source={})), **metadata}
    assert stated(join(read_stamp(stamp, "here"), HERE).contract) == stated(made)

    values = join(read_csv(metadata, "here"), HERE).values
    for name in ("joint_stiffness", "joint_damping", "default_joint_pos", "action_scale"):
        assert np.broadcast_to(values[name], getattr(made, name).shape).tobytes() == getattr(made, name).tobytes()
    assert (values["joint_names"], values["lookahead_steps"]) == (made.joint_names, made.lookahead_steps)

    document = stated(made)
    if document["command_ranges"] is not None:
        axes = ("lin_vel_x", "lin_vel_y", "ang_vel_z")
        document["command_ranges"] = dict(zip(axes, document["command_ranges"], strict=True))
    path = tmp_path / "contract.yaml"
    path.write_text(yaml.dump(document, sort_keys=False))
    assert stated(join([read_contract_file(path)], HERE).contract) == stated(made)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("joint_stiffnes: 1", "unknown field 'joint_stiffnes' (did you mean 'joint_stiffness'?)"),
        ("policy_dt: 0.02\npolicy_dt: 0.04", "'policy_dt' is given twice"),
        ("phase: 3", "phase: is 3, expected a mapping"),
        ("observation: [{name: joint_pos, history: long}]", "history"),
        ("policy_dt: !!python/name:os.system x", "policy_dt: is x"),
        ("joint_stiffness: stiff", "joint_stiffness: is stiff: expected a number"),
        ("joint_stiffness: {nose: 1.0}", "unknown joint 'nose'"),
        ("joint_stiffness: {'.*': 1.0, '.*_knee': 2.0}", "unknown joint '.*_knee'"),
        ("command_ranges: [1.0, [0, 1], [0, 1]]", "expected a number"),
        ("joint_stiffness: [1.0, 2.0, -3.0]", "joint_stiffness: is -3.0 for c"),
        ("policy_dt: fast", "policy_dt: is fast"),
        ("action_joint_names: [7]", "expected places of 3 joints"),
        ("action_joint_names: ['[']", "has no pattern"),
        ("terms: {mood: {scale: 2.0}}", "of no observation term, expected one of joint_pos, joint_vel"),
        ("terms: {joint_pos: {colour: 1}}", "colour"),
        ("position_clip: {a: [0, 1], b: 2}", "position_clip"),
    ],
)
def test_a_contract_yaml_that_is_wrong_is_one_line(tmp_path, text, message):
    path = tmp_path / "policy.contract.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"policy\.contract\.yaml") as caught:
        join([*read_csv(write_metadata(contract()), "here"), read_contract_file(path)], HERE)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_file_of_a_checkpoint_is_found(tmp_path):
    model = tmp_path / "walk.onnx"
    assert find_contract(model) is None
    (tmp_path / "contract.yml").touch()
    assert find_contract(model) == tmp_path / "contract.yml"
    (tmp_path / "contract.yaml").touch()
    assert find_contract(model) == tmp_path / "contract.yaml"
    (tmp_path / "walk.contract.yaml").touch()
    assert find_contract(model) == tmp_path / "walk.contract.yaml"


@pytest.mark.parametrize("text", EXAMPLES)
def test_every_example_of_the_page_is_read(tmp_path, text):
    assert len(EXAMPLES) >= 3
    path = tmp_path / "contract.yaml"
    path.write_text(text)
    document = yaml.safe_load(text)
    joints = document.get("joint_names", ["left_hip", "left_knee"])
    terms = list(dict.fromkeys([*document.get("terms", {}), "joint_pos"]))
    (tmp_path / "base.yaml").write_text(yaml.safe_dump({"joint_names": joints, "observation": terms}))
    assert join([read_contract_file(tmp_path / "base.yaml"), read_contract_file(path)], HERE).values
