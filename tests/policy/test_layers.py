"""Layers of a contract: the later one wins, and two trainer's sources that differ are both named, joint by joint."""

from pathlib import Path

import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import zero_policy
from humanoid_sim.policy.layers import Layer, join
from humanoid_sim.policy.loaded_policy import contract_layout, load_policy

PATH = Path("policy.onnx")
JOINTS = ("hip", "knee", "waist")
WHOLE = {
    "joint_names": JOINTS,
    "joint_stiffness": [40.179, 99.098, 40.179],
    "joint_damping": [2.558, 6.309, 2.558],
    "default_joint_pos": [-0.1, 0.3, 0.0],
    "observation": ("base_ang_vel", "joint_pos", "actions"),
    "action_scale": [0.548, 0.351, 0.548],
    "policy_dt": 0.02,
}


def joined(*layers, **changes):
    return join([Layer("metadata", {**WHOLE, **changes}), *layers], PATH)


def deploy(**values):
    return Layer("deploy.yaml", values)


def by_hand(**values):
    return Layer("policy.contract.yaml", values, is_decisive=True)


def test_a_rounded_copy_is_no_difference_and_the_exact_value_is_used():
    exact = {"joint_stiffness": [40.179, 99.098, 40.179], "action_scale": [0.548, 0.351, 0.075]}
    copy = {"joint_stiffness": [40.2, 99.1, 40.2], "action_scale": [0.55, 0.35, 0.07]}
    for first, second in ((exact, copy), (copy, exact)):
        reading = joined(deploy(**second), **first)
        assert reading.differences == {}
        assert {field: getattr(reading.contract, field).tolist() for field in exact} == exact


@pytest.mark.parametrize(
    ("field", "other", "named"),
    [
        ("action_scale", [0.55, 0.35, 0.35], ("waist (0.548 against 0.35)", "metadata", "deploy.yaml")),
        ("joint_stiffness", [40.2, 99.2, 40.2], ("differ: knee (99.098 against 99.2) ",)),
        ("joint_stiffness", 20.0, ("hip (40.179 against 20)", "knee (99.098 against 20)")),
        ("observation", ("joint_pos", "base_ang_vel", "actions"), ("at place 0: base_ang_vel",)),
        ("observation", ("imu_ang_vel", "joint_pos_rel"), ("at place 2: actions in metadata, nothing in deploy.yaml",)),
        ("joint_names", ("knee", "hip", "waist"), ("the order differs at place 0",)),
    ],
)
def test_a_difference_names_the_joints_and_no_rounded_neighbour(field, other, named):
    reading = joined(deploy(**{field: other}))
    ((name, line),) = reading.problems.items()
    assert name == field
    for text in named:
        assert text in line
    assert "0.55" not in line


def test_all_fields_that_differ_are_named_together_and_a_person_decides_between_them():
    other = deploy(action_scale=0.25, joint_damping=1.0, command_ranges=[[0, 1], [0, 0], [0, 0]])
    reading = joined(other, command_ranges=[[0, 2], [0, 0], [0, 0]])
    assert reading.differences.keys() == {"action_scale", "joint_damping"}
    reading = joined(other, by_hand(action_scale=0.25, joint_damping=[2.5, 6.3, 2.5]))
    assert reading.differences == {}
    assert reading.contract.action_scale.tolist() == [0.25] * 3
    assert reading.source["joint_damping"] == "policy.contract.yaml"
    assert [old.source for old in reading.replaced["joint_damping"]] == ["metadata", "deploy.yaml"]


def test_what_is_stated_comes_before_what_a_dialect_implies():
    implied = Layer("assumed (mjlab)", {"policy_dt": 0.02, "action_limit": 10.0})
    reading = join([deploy(**{**WHOLE, "policy_dt": 0.04}), implied], PATH)
    assert (reading.contract.policy_dt, reading.contract.action_limit) == (0.04, 10.0)
    assert (reading.source["policy_dt"], reading.source["action_limit"]) == ("deploy.yaml", "assumed (mjlab)")
    assert reading.differences == {}


def test_everything_that_is_missing_is_named_at_once_and_widths_are_known_all_the_same():
    given = {"joint_names": JOINTS, "observation": ("motion_anchor_ori_b", "joint_pos", "gait_phase", "command")}
    reading = join([deploy(**given)], PATH)
    assert reading.contract is None
    assert set(reading.missing) == {
        *("joint_stiffness", "joint_damping", "default_joint_pos", "action_scale", "policy_dt"),
        *("anchor_body", "phase.period", "command_names"),
    }
    reading = join([deploy(**given, command_names=["twist"])], PATH)
    assert contract_layout(reading.outline).width == 6 + 3 + 4 + 3
    assert joined(by_hand(**{"phase.offsets": [0.0]})).missing == ("phase.period",)  # that no term needs


def test_values_by_name_pattern_and_place():
    reading = joined(
        by_hand(
            joint_stiffness={".*": 10.0, "knee": 20.0},
            effort_limit={"waist": 5.0},
            action_joint_names=[2, 0],
            action_scale=[0.1, 0.2],
            **{"observation.joint_pos.joints": slice(0, 2)},
        )
    )
    contract = reading.contract
    assert contract.joint_stiffness.tolist() == [10.0, 20.0, 10.0]
    assert contract.effort_limit.tolist() == [np.inf, np.inf, 5.0]
    assert contract.action_joint_names == ("waist", "hip")
    assert contract.terms[1].joints == ("hip", "knee")


def test_a_live_input_on_a_topic_of_the_sessions_own_is_refused():
    wiring = joined(by_hand(**{"observation": ["tf"], "observation.tf.width": 2}))
    with pytest.raises(InputError, match="live input 'tf': its topic is /tf, which a session uses itself"):
        load_policy(wiring.contract, zero_policy(3), None)


def test_sources_may_call_terms_differently():
    options = {"observation": ("imu_ang_vel", "joint_pos_rel", "last_action"), "observation.joint_pos_rel.scale": 0.5}
    reading = joined(deploy(**options))
    assert reading.differences == {}
    assert reading.contract.observation_names == ("imu_ang_vel", "joint_pos_rel", "last_action")
    reading = joined(by_hand(**{"observation.joint_pos_rel.scale": 0.5}))
    assert float(reading.contract.terms[1].scale) == 0.5
