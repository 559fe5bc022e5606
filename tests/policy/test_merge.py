"""Sources that agree, round, contradict each other or leave something out; and overrides."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.errors import InputError
from humanoid_sim.policy.readers.contract_yaml import parse_contract
from humanoid_sim.policy.readers.merge import agreed, merge
from humanoid_sim.policy.readers.partial import Given, PartialContract
from humanoid_sim.policy.readers.partial import given as from_source

MODEL = "policy.onnx"
WHOLE = {
    "joint_names": ("hip", "knee"),
    "joint_stiffness": np.array([40.179, 99.098]),
    "joint_damping": np.array([2.558, 6.309]),
    "default_joint_pos": np.array([-0.312, 0.669]),
    "observation": ("base_ang_vel", "joint_pos", "actions"),
    "action_scale": np.array([0.548, 0.351]),
    "policy_dt": 0.02,
}


def source(values=WHOLE, name="metadata", *left_out, **terms):
    fields = {key: value for key, value in values.items() if key not in left_out}
    options = {term: from_source(name, each) for term, each in terms.items()}
    return PartialContract(name, from_source(name, fields), options)


def yaml(**document):
    return parse_contract(document, "contract.yaml", "contract.yaml")


def refusal(*partials, robot=None):
    with pytest.raises(InputError) as caught:
        merge(partials, MODEL, robot)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(f"{MODEL}: ")
    return text.removeprefix(f"{MODEL}: ")


def test_every_field_says_where_it_comes_from():
    contract = merge([source(WHOLE, "metadata", "policy_dt"), *yaml(policy_dt=0.04)], MODEL)
    assert contract.policy_dt == 0.04
    assert contract.provenance["policy_dt"] == "contract.yaml"
    assert contract.provenance["joint_stiffness"] == "metadata"
    assert contract.provenance["action_joint_names"] == "follows from joint_names"
    assert contract.provenance["action_offset"] == "follows from default_joint_pos"
    assert contract.provenance["task_type"] == "follows from the observation"
    assert contract.provenance["action_clip"] == "default"


def test_two_sources_that_contradict_each_other_are_both_shown():
    assert refusal(source(), *yaml(policy_dt=0.04)) == (
        "policy_dt: 0.02 in metadata contradicts 0.04 in contract.yaml; "
        "if one of them is wrong, write the right one under override: in x.contract.yaml, "
        "or leave out a source that is wrong as a whole with ignore:"
    )


def test_the_order_of_terms_decides():
    assert refusal(source(), *yaml(observation=["joint_pos", "base_ang_vel", "actions"])).startswith(
        "observation: the order differs: at place 0 base_ang_vel in metadata contradicts joint_pos in contract.yaml; if"
    )


def test_an_override_wins_and_says_so():
    overrides = {"policy_dt": 0.04, "terms": {"joint_pos": {"relative": False, "scale": 2.0}}}
    contract = merge([source(joint_pos={"scale": 1.0}), *yaml(override=overrides)], MODEL)
    assert contract.policy_dt == 0.04
    assert contract.provenance["policy_dt"] == "contract.yaml override"
    assert contract.terms[1].relative is False
    assert float(contract.terms[1].scale) == 2.0
    assert contract.provenance["observation.joint_pos.scale"] == "contract.yaml override"


def test_what_is_stated_comes_before_what_is_assumed():
    assuming = PartialContract("mjlab metadata", assumed=from_source("assumed (mjlab)", {"policy_dt": 0.02}))
    without = source(WHOLE, "metadata", "policy_dt")
    assert merge([assuming, without], MODEL).provenance["policy_dt"] == "assumed (mjlab)"
    contract = merge([assuming, without, *yaml(policy_dt=0.04)], MODEL)
    assert (contract.policy_dt, contract.provenance["policy_dt"]) == (0.04, "contract.yaml")


def test_everything_that_is_missing_is_named_with_what_was_read():
    lacking = source(WHOLE, "metadata", "policy_dt", "action_scale")
    assert refusal(lacking, *yaml(action_clip=10)) == (
        "the contract lacks action_scale, policy_dt; read: metadata (joint_names, joint_stiffness, joint_damping, "
        "default_joint_pos, observation); contract.yaml (action_clip); give what is missing in policy.contract.yaml"
    )


@pytest.mark.parametrize(
    ("terms", "missing"),
    [
        (("gait_phase",), "phase"),
        (("motion_anchor_ori_b",), "anchor_body"),
        (("motion_ref_ori_b",), "anchor_body"),
        (("motion_body_pos_b",), "body_names"),
        (("target_keys_future",), "lookahead_steps"),
        (("command",), "command_names"),
    ],
)
def test_terms_need_their_fields(terms, missing):
    assert refusal(source({**WHOLE, "observation": terms})).startswith(f"the contract lacks {missing}; ")


@pytest.mark.parametrize(
    ("terms", "commands", "task"),
    [
        (("joint_pos",), (), "locomotion"),
        (("command",), ("twist",), "locomotion"),
        (("command",), ("motion",), "tracking"),
        (("motion_command",), (), "tracking"),
        (("target_keys",), (), "piano"),
    ],
)
def test_the_task_follows_from_the_terms(terms, commands, task):
    values = {**WHOLE, "observation": terms, "command_names": commands}
    assert merge([source(values)], MODEL).task_type == task


def test_a_value_that_does_not_fit_names_its_source():
    assert refusal(source(), *yaml(override={"joint_damping": [1.0, 2.0, 3.0]})) == (
        "joint_damping: has shape (3,), expected (2,), one value per joint (contract.yaml override)"
    )


def test_places_need_a_robot():
    placed = source({**WHOLE, "joint_places": (1, 0)}, "deploy.yaml", "joint_names")
    assert refusal(placed) == (
        "joint_names: deploy.yaml gives the joints by their places on the robot, and no robot is known; "
        "name the robot, or give joint_names in x.contract.yaml"
    )
    assert merge([placed], MODEL, ("knee", "hip")).joint_names == ("hip", "knee")
    assert merge([placed, *yaml(joint_names=["hip", "knee"])], MODEL).joint_names == ("hip", "knee")
    assert (
        refusal(placed, robot=("hip",)) == "joint_ids_map: leads to place 1 (deploy.yaml), but the robot has 1 joints"
    )
    # Three places of a robot that has only these joints: the gaps stand for joints that it lacks.
    gaps = source({**WHOLE, "joint_places": (7, 2)}, "deploy.yaml", "joint_names")
    assert merge([gaps], MODEL, ("knee", "hip")).joint_names == ("hip", "knee")


def rounded(values, decimals):
    return Given(np.round(values, decimals), "coarse", decimals)


@given(st.lists(st.floats(-200.0, 200.0), min_size=1, max_size=5).map(np.array), st.integers(3, 6))
def test_a_rounded_copy_agrees_and_the_precise_one_wins(values, decimals):
    fine = Given(values, "fine")
    for pair in ((fine, rounded(values, decimals)), (rounded(values, decimals), fine)):
        both = agreed("joint_stiffness", *pair)
        np.testing.assert_allclose(both.value, values, rtol=1e-9)
        if not np.allclose(values, np.round(values, decimals), rtol=1e-9, atol=0.0):
            assert both.source == "fine (coarse has it rounded)"


@given(st.lists(st.floats(1.0, 200.0), min_size=1, max_size=5).map(np.array), st.sampled_from([0.6, 1.0, 3.0]))
def test_what_is_off_by_more_than_rounding_contradicts(values, steps):
    values = np.round(values, 3)
    # With fewer decimals the other one could itself be a rounded copy: 64.09 of 64.089.
    assert agreed("joint_stiffness", Given(values, "a", 3), Given(values + 1e-3 * steps, "b", 4)) is None
