import models
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.policy.metadata import METADATA_KEYS, write_metadata
from humanoid_sim.policy.readers.merge import merge
from humanoid_sim.policy.readers.sources import metadata_contract

GOOD = write_metadata(models.contract())
KEPT = (*METADATA_KEYS, "action_offset")


def parsed(metadata):
    return merge(metadata_contract(metadata, "model.onnx"), "model.onnx")


names = st.text(st.characters(codec="utf-8", exclude_characters=","), min_size=1).filter(lambda s: s == s.strip())
numbers = st.floats(allow_nan=False, allow_infinity=False)
gains = st.floats(0.0, allow_infinity=False)


@st.composite
def contracts(draw):
    joints = draw(st.lists(names, min_size=1, max_size=6, unique=True))
    actions = draw(st.lists(st.sampled_from(joints), min_size=1, unique=True))
    n, m = len(joints), len(actions)
    return PolicyContract(
        task_type=draw(st.sampled_from(["tracking", "piano", "locomotion"])),
        joint_names=tuple(joints),
        action_joint_names=tuple(actions),
        joint_stiffness=np.array(draw(st.lists(gains, min_size=n, max_size=n))),
        joint_damping=np.array(draw(st.lists(gains, min_size=n, max_size=n))),
        default_joint_pos=np.array(draw(st.lists(numbers, min_size=n, max_size=n))),
        observation=tuple(draw(st.lists(names, min_size=1, max_size=4, unique=True))),
        command_names=tuple(draw(st.lists(names, max_size=3, unique=True))),
        action_scale=np.array(draw(st.lists(numbers, min_size=m, max_size=m))),
        policy_dt=draw(st.floats(0.0, exclude_min=True, allow_infinity=False)),
        body_names=tuple(draw(st.lists(names, max_size=3, unique=True))),
        dataset_repo_id=draw(st.text().map(str.strip)),
        lookahead_steps=tuple(draw(st.lists(st.integers(0, 10**6), max_size=3))),
    )


@given(contracts())
def test_a_contract_survives_its_metadata_bit_for_bit(contract):
    metadata = write_metadata(contract)
    assert tuple(metadata) == METADATA_KEYS
    again = parsed(metadata)
    for field in KEPT:
        before, after = getattr(contract, field), getattr(again, field)
        if isinstance(before, np.ndarray):
            assert before.tobytes() == after.tobytes(), field
        else:
            assert before == after, field


def test_the_keys_are_the_thirteen_of_the_format():
    assert len(METADATA_KEYS) == 13
    assert GOOD == {
        "task_type": "locomotion",
        "joint_names": "a,b,c",
        "action_joint_names": "c,a",
        "joint_stiffness": "50.0,40.0,30.0",
        "joint_damping": "2.0,1.5,1.0",
        "default_joint_pos": "0.1,0.2,0.3",
        "observation_names": "joint_pos,joint_vel,actions",
        "command_names": "",
        "action_scale": "0.5,0.25",
        "policy_dt": "0.02",
        "body_names": "",
        "dataset_repo_id": "",
        "lookahead_steps": "",
    }


def test_one_number_stands_for_all_and_spaces_do_not_matter():
    contract = parsed(
        {**GOOD, "joint_stiffness": " 5 ", "action_scale": "0.5", "joint_names": " a, b ,c ", "task_type": " piano\n"}
    )
    assert contract.joint_stiffness.tolist() == [5.0, 5.0, 5.0]
    assert contract.action_scale.tolist() == [0.5, 0.5]
    assert contract.joint_names == ("a", "b", "c")
    assert contract.task_type == "piano"


def message(metadata):
    with pytest.raises(InputError) as caught:
        parsed(metadata)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith("model.onnx: ")
    assert "PolicyContract" not in text
    return text.removeprefix("model.onnx: ").removesuffix(" (metadata)")


WRONG = [
    ("task_type", "dancing", "task_type: is 'dancing', expected one of tracking, piano, locomotion"),
    ("task_type", "", "task_type: is '', expected one of tracking, piano, locomotion"),
    ("joint_names", "", "joint_names: is empty, expected at least one name"),
    ("joint_names", "a,,c", "joint_names: holds '', expected names"),
    ("joint_names", "a,b,a", "joint_names: names a more than once"),
    ("joint_names", "a,b", "action_joint_names: c not in joint_names: a, b"),
    ("joint_names", "a,b,c,d", "joint_stiffness: has shape (3,), expected (4,), one value per joint"),
    ("action_joint_names", "", "action_joint_names: is empty, expected at least one name"),
    ("action_joint_names", "c,x", "action_joint_names: x not in joint_names: a, b, c"),
    ("action_joint_names", "c,c", "action_joint_names: names c more than once"),
    ("action_joint_names", "c,a,b", "action_scale: has shape (2,), expected (3,), one value per joint"),
    ("joint_stiffness", "", "joint_stiffness is empty, expected numbers separated by commas"),
    ("joint_stiffness", "1,2,x", "joint_stiffness is '1,2,x', expected numbers separated by commas"),
    ("joint_stiffness", "1,2,", "joint_stiffness is '1,2,', expected numbers separated by commas"),
    ("joint_stiffness", "1,2", "joint_stiffness: has shape (2,), expected (3,), one value per joint"),
    ("joint_stiffness", "1,-2,3", "joint_stiffness: is -2.0 for b, expected a finite number >= 0"),
    ("joint_damping", "1,nan,3", "joint_damping: is nan for b, expected a finite number >= 0"),
    ("joint_damping", "[1, 2, 3]", "joint_damping is '[1, 2, 3]', expected numbers separated by commas"),
    ("default_joint_pos", "1,2,inf", "default_joint_pos: is inf for c, expected a finite number"),
    ("default_joint_pos", "1 2 3", "default_joint_pos is '1 2 3', expected numbers separated by commas"),
    ("observation_names", "", "observation: is empty, expected at least one name"),
    ("observation_names", "joint_pos,joint_pos", "observation: names joint_pos more than once"),
    ("command_names", "x,,y", "command_names: holds '', expected names"),
    ("action_scale", "1,2,3", "action_scale: has shape (3,), expected (2,), one value per joint"),
    ("action_scale", "nan", "action_scale: is nan for c, expected a finite number"),
    ("policy_dt", "", "policy_dt is '', expected one number"),
    ("policy_dt", "fast", "policy_dt is 'fast', expected one number"),
    ("policy_dt", "0.02,0.02", "policy_dt is '0.02,0.02', expected one number"),
    ("policy_dt", "0", "policy_dt: is 0.0, expected a finite number > 0"),
    ("policy_dt", "-0.02", "policy_dt: is -0.02, expected a finite number > 0"),
    ("policy_dt", "inf", "policy_dt: is inf, expected a finite number > 0"),
    ("body_names", "hand,hand", "body_names: names hand more than once"),
    ("lookahead_steps", "1,2.5", "lookahead_steps is '1,2.5', expected integers separated by commas"),
    ("lookahead_steps", "-1", "lookahead_steps: is (-1,), expected integers >= 0"),
]


@pytest.mark.parametrize(("key", "value", "expected"), WRONG)
def test_a_wrong_value_is_named_with_what_is_accepted(key, value, expected):
    assert message({**GOOD, key: value}) == expected


def test_future_keys_need_their_lookahead():
    assert message({**GOOD, "observation_names": "target_keys_future"}) == (
        "lookahead_steps: is empty, but the observation has target_keys_future"
    )


@pytest.mark.parametrize("name", ["left,elbow", " left", "left\n"])
@pytest.mark.parametrize("key", ["joint_names", "observation_names", "command_names", "body_names"])
def test_names_that_csv_cannot_keep_are_not_written(key, name):
    changes = {"observation" if key == "observation_names" else key: (name,)}
    if key == "joint_names":
        changes |= {
            "action_joint_names": (name,),
            "joint_stiffness": 1.0,
            "joint_damping": 1.0,
            "default_joint_pos": 0.0,
            "action_scale": 1.0,
        }
    with pytest.raises(FieldError, match=f"PolicyContract.{key}: .* which CSV cannot keep"):
        write_metadata(models.contract(**changes))
