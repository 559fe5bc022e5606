from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from doctor_examples import BREADTH_FIRST, CONTRACTS, FACTS, JOINTS, tracker, walker
from mistakes import (
    action_scale_one,
    fields,
    gains_swapped,
    gravity_flipped,
    imu_axes,
    scales_one,
    sides_swapped,
    term,
    turned_round,
)

from humanoid_sim.doctor.edits import mirrored
from humanoid_sim.doctor.hypotheses import Hypothesis, same_contract, singles
from humanoid_sim.doctor.hypotheses import _contract_key as contract_key

FEWEST = 50
MOST = 140
"""The space is bounded: a search has to end."""


@cache
def space(name):
    """The single edits of a sample contract, which does not change."""
    return singles(CONTRACTS[name](), FACTS)


def named(found, name):
    (match,) = (hypothesis for hypothesis in found if hypothesis.name == name)
    return match.contract


def cures(wrong, right):
    """Causes of the single edits that turn one contract into the other."""
    key = contract_key(right)
    return [found.cause for found in singles(wrong, FACTS) if contract_key(found.contract) == key]


@pytest.mark.parametrize("name", sorted(CONTRACTS))
def test_every_single_edit_changes_something_and_no_two_the_same(name):
    found = space(name)
    assert FEWEST <= len(found) <= MOST
    wirings = {hypothesis.name: contract_key(hypothesis.contract) for hypothesis in found}
    assert len(wirings) == len(found) == len(set(wirings.values()))
    assert contract_key(CONTRACTS[name]()) not in wirings.values()
    for hypothesis in found:
        assert len(hypothesis.explanation) > 10
        assert "\n" not in hypothesis.explanation


def test_the_present_contract_is_a_hypothesis_without_edits():
    unchanged = Hypothesis(None, walker())
    assert unchanged.name == "as it is"
    assert unchanged.cause == ""
    assert unchanged.doubt == 0.0


def test_the_usual_mistakes_are_in_the_space():
    causes = {h.cause for name in CONTRACTS for h in space(name)}
    assert causes >= {
        "joint order", "term order", "projected_gravity sign", "base_ang_vel frame", "base_lin_vel frame",
        "motion_anchor_pos_b frame", "anchor body", "motion_anchor_ori_b layout", "motion_anchor_ori_b direction",
        "joint_vel zeroed", "actions zeroed", "observation scales", "imu_quaternion order",
        "reference quaternion order", "joint_pos relative", "command relative", "actions form", "action scale",
        "action offset", "history order", "history layout", "reference alignment", "rate", "gains",
        "gains of equal joints", "default pose",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("make", "wrong", "cause"),
    [
        (walker, fields(history_layout="per_step"), "history layout"),
        (walker, term("imu_quaternion", quaternion="xyzw"), "imu_quaternion order"),
        (walker, term("base_ang_vel", frame="world"), "base_ang_vel frame"),
        (walker, gravity_flipped, "projected_gravity sign"),
        (walker, fields(policy_dt=0.04), "rate"),
        (tracker, fields(policy_dt=0.01), "rate"),
        (tracker, fields(anchor_body="pelvis"), "anchor body"),
        (tracker, fields(reference_quaternion="xyzw"), "reference quaternion order"),
        (tracker, fields(align_reference=False), "reference alignment"),
        (tracker, term("command", relative=True), "command relative"),
        (tracker, term("motion_anchor_ori_b", layout="two_rows"), "motion_anchor_ori_b layout"),
        (tracker, term("motion_anchor_ori_b", layout="columns"), "motion_anchor_ori_b layout"),
        (tracker, term("motion_anchor_ori_b", inverse=True), "motion_anchor_ori_b direction"),
        (tracker, term("actions", scale=0.0), "actions zeroed"),
        (tracker, term("actions", form="scaled"), "actions form"),
        (tracker, fields(action_offset=0.0), "action offset"),
        (tracker, fields(joint_names=BREADTH_FIRST, action_joint_names=BREADTH_FIRST), "joint order"),
    ],
)
def test_a_mistake_is_undone_by_an_edit_of_its_own_cause(make, wrong, cause):
    right = make()
    assert cures(wrong(right), right) == [cause]


def test_scales_that_were_all_left_at_one_are_found_again():
    right = replace(
        walker(),
        observation=[replace(item, scale=1.0) if item.name != "base_ang_vel" else item for item in walker().terms],
    )
    right = term("joint_vel", scale=0.05)(right)
    assert cures(scales_one(right), right) == ["observation scales"]


def test_the_action_scale_of_mjlab_follows_from_effort_limits_and_gains():
    scale = 0.25 * np.array([80.0, 60.0, 80.0, 60.0]) / np.array([40.0, 41.0, 42.0, 43.0])
    right = replace(tracker(), action_scale=np.round(scale, 3))
    assert cures(action_scale_one(right), right) == ["action scale"]


def test_the_action_scale_of_a_g1_follows_from_its_gains_where_its_model_has_no_effort_limits():
    robot = replace(FACTS, effort_limit=np.full(4, np.inf))
    right = replace(
        tracker(), joint_stiffness=[40.179, 99.098, 28.501, 16.778], action_scale=[0.548, 0.351, 0.439, 0.075]
    )
    found = [h for h in singles(action_scale_one(right), robot) if same_contract(h.contract, right)]
    assert [h.name for h in found] == ["action scale from effort limits"]
    assert not any("effort" in h.name for h in singles(tracker(), robot))  # whose gains are those of no G1


def test_names_in_another_order_keep_the_values_in_their_places():
    changed = named(space("walker"), "joint order the robot's, values stay in place")
    assert changed.joint_names == JOINTS
    np.testing.assert_array_equal(changed.joint_stiffness, walker().joint_stiffness)
    # Place by place: left_knee was third, right_hip is now.
    assert changed.action_joint_names == ("right_hip", "left_hip", "left_knee")
    assert changed.terms[3].joints == ("left_knee", "left_hip")


def test_an_observation_in_another_order_takes_the_values_along():
    changed = named(space("walker"), "joint order the robot's, values move along")
    assert changed.joint_names == JOINTS
    assert changed.joint_stiffness.tolist() == [40.0, 42.0, 41.0, 43.0]
    assert changed.default_joint_pos.tolist() == [-0.1, 0.3, -0.2, 0.4]
    assert changed.action_joint_names == ("left_hip", "left_knee", "right_hip")
    assert changed.action_scale.tolist() == [0.6, 0.5, 0.7]
    shown = changed.terms[3]
    assert shown.joints == ("left_hip", "right_hip")
    assert np.asarray(shown.scale).tolist() == [2.0, 1.0]


def test_values_listed_in_another_order_find_their_joints():
    changed = named(space("walker"), "gains listed in the robot's order")
    # The list 40, 41, 42, 43 was meant for left_hip, left_knee, right_hip, right_knee.
    assert dict(zip(changed.joint_names, changed.joint_stiffness.tolist(), strict=True)) == {
        "left_hip": 40.0,
        "left_knee": 41.0,
        "right_hip": 42.0,
        "right_knee": 43.0,
    }


def test_a_new_default_pose_moves_the_action_with_it():
    changed = named(space("walker"), "default pose the robot's initial position")
    assert changed.default_joint_pos.tolist() == [0.1, 0.1, 0.2, 0.2]
    assert np.asarray(changed.action_offset).tolist() == [0.2, 0.1, 0.1]
    absolute = replace(walker(), action_offset=0.0)
    changed = named(singles(absolute, FACTS), "default pose the robot's initial position")
    assert np.asarray(changed.action_offset).tolist() == [0.0, 0.0, 0.0]


def test_mirrored_names():
    for left, right in (
        ("left_hip", "right_hip"),
        ("leg_left_knee", "leg_right_knee"),
        ("L_arm", "R_arm"),
        ("LL_HR", "LR_HR"),
        ("LeftElbow", "RightElbow"),
        ("hip_l", "hip_r"),
    ):
        assert mirrored((right, "waist_roll", left)) == {left: right, right: left}
    assert mirrored(("left_hip", "knee", "lever", "rever")) == {}


def test_a_joint_that_turns_the_other_way_is_found_again():
    changed = named(space("walker"), "left_hip turned round")
    assert changed.action_scale.tolist() == [0.5, -0.6, 0.7]
    assert changed.default_joint_pos.tolist() == [0.1, -0.2, 0.3, 0.4]
    assert np.asarray(changed.action_offset).tolist() == [0.3, 0.1, -0.2]
    assert np.asarray(changed.terms[3].scale).tolist() == [1.0, -2.0]
    assert cures(turned_round("right_knee")(tracker()), tracker()) == ["joint direction"]


@pytest.mark.parametrize(
    ("wrong", "cause"),
    [
        (imu_axes("y -x z"), "IMU axes"),
        (term("base_lin_vel", at="imu"), "base_lin_vel point"),
        (term("base_lin_vel", at="chest"), "base_lin_vel point"),
        (gains_swapped("left_hip", "left_knee"), "gains of two joints"),
        (sides_swapped("left", "right"), "joint order"),
    ],
)
def test_what_is_of_one_joint_or_of_the_imu_is_found_again(wrong, cause):
    right = replace(tracker(), joint_stiffness=[40.0, 41.0, 40.0, 41.0], joint_damping=1.0)
    assert cures(wrong(right), right) == [cause]


def test_a_velocity_may_be_that_of_a_site():
    robot = replace(FACTS, points=("chest",))
    assert named(singles(tracker(), robot), "base_lin_vel at the site 'chest'").terms[3].at == "chest"


def test_gains_that_are_alike_on_both_sides_stay_so():
    right = replace(tracker(), joint_stiffness=[40.0, 41.0, 40.0, 41.0], joint_damping=1.0)
    found = [h for h in singles(right, FACTS) if h.cause == "gains of two joints"]
    assert [h.contract.joint_stiffness.tolist() for h in found] == [[41.0, 40.0, 41.0, 40.0]]


def test_the_models_own_damping_is_a_hypothesis_where_there_is_one():
    assert not any("model's joint damping" in hypothesis.name for hypothesis in space("walker"))
    robot = replace(FACTS, own_damping={"left_hip": 0.5})
    assert named(singles(walker(), robot), "the model's joint damping dropped").model_joint_damping == "drop"
    dropped = replace(walker(), model_joint_damping="drop")
    assert named(singles(dropped, robot), "the model's joint damping kept").model_joint_damping == "keep"


def test_gains_of_a_limb_alone_are_found_again():
    right = replace(
        tracker(),
        joint_names=("left_hip", "left_shoulder", "right_hip", "waist_yaw"),
        action_joint_names=("left_hip", "left_shoulder", "right_hip", "waist_yaw"),
    )
    wrong = replace(right, joint_stiffness=[80.0, 41.0, 84.0, 43.0], joint_damping=[2.0, 1.1, 2.4, 1.3])
    facts = replace(FACTS, joint_names=right.joint_names, breadth_first=right.joint_names)
    found = {h.name: h for h in singles(wrong, facts)}
    assert same_contract(found["gains of the legs × 0.5"].contract, right)
    assert "(left_hip, right_hip)" in found["gains of the legs × 0.5"].explanation
    assert {name for name in found if name.startswith("gains of the ")} >= {
        "gains of the arms × 2",
        "gains of the waist × 2",
    }
    assert "gains of the ankles × 2" not in found  # it has none


def test_gains_of_joints_with_equal_ones_are_found_again():
    right = replace(tracker(), joint_stiffness=[40.0, 60.0, 40.0, 60.0], joint_damping=[1.0, 3.0, 1.0, 3.0])
    wrong = replace(right, joint_stiffness=[20.0, 60.0, 20.0, 60.0], joint_damping=[0.5, 3.0, 0.5, 3.0])
    found = {h.name: h for h in singles(wrong, FACTS)}
    assert same_contract(found["gains of the joints with stiffness 20 and damping 0.5 × 2"].contract, right)
    assert same_contract(found["gains of the joints with stiffness 60 and damping 3 × 2"].contract, right) is False


def test_a_new_order_takes_every_value_of_a_joint_along():
    clip = [[-1.0, 1.0], [-2.0, 2.0], [-3.0, 3.0], [-4.0, 4.0]]
    right = replace(tracker(), position_clip=clip, effort_limit=[10.0, 20.0, 30.0, 40.0])
    changed = named(singles(right, FACTS), "joint order breadth-first (Isaac), values move along")
    assert np.asarray(changed.position_clip)[:, 1].tolist() == [1.0, 3.0, 2.0, 4.0]
    assert np.asarray(changed.effort_limit).tolist() == [10.0, 30.0, 20.0, 40.0]
    assert np.asarray(changed.action_offset).tolist() == [-0.1, 0.3, -0.2, 0.4]
