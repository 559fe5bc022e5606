from dataclasses import replace

import numpy as np
import pytest
from doctor_examples import tracker

from humanoid_sim.assets import SAMPLE_POLICY
from humanoid_sim.doctor.examined_policy import ExaminedPolicy, load_examined, robot_facts
from humanoid_sim.errors import InputError
from humanoid_sim.policy.motion import Motion
from humanoid_sim.robots.description import load_robot

JOINTS = ("left_hip", "left_knee", "right_hip", "right_knee")
MJCF = """
<mujoco><worldbody><body name="pelvis" pos="0 0 1"><freejoint/><geom size="0.1"/>
  <body name="left_thigh"><joint name="left_hip" axis="0 1 0"/><geom size="0.1"/>
    <body name="left_shin"><joint name="left_knee" axis="0 1 0"/><geom size="0.1"/></body></body>
  <body name="right_thigh"><joint name="right_hip" axis="0 1 0"/><geom size="0.1"/>
    <body name="right_shin"><joint name="right_knee" axis="0 1 0"/><geom size="0.1"/></body></body>
</body></worldbody></mujoco>
"""


def motion(frames=4):
    columns = 2 * 4 + 7 * 2
    table = np.arange(frames * columns, dtype=np.float32).reshape(frames, columns)
    return Motion(table, ("pelvis", "torso"), 0.02, layout="joints_bodies_w", joint_names=JOINTS)


def examined(tmp_path, *, in_policy_order):
    path = tmp_path / "robot.xml"
    path.write_text(MJCF)
    return ExaminedPolicy(tracker(), lambda *_: np.zeros(4), load_robot(path), motion(), in_policy_order)


def quaternions(read):
    return read.frames[0, 14:18].astype(np.float64)


def test_breadth_first_goes_level_by_level(tmp_path):
    found = examined(tmp_path, in_policy_order=True)
    facts = robot_facts(found.description, found.motion)
    assert facts.breadth_first == ("left_hip", "right_hip", "left_knee", "right_knee")
    assert facts.joint_names == JOINTS
    assert facts.motion_bodies == ("pelvis", "torso")


def test_a_motion_in_the_graph_goes_by_the_places_of_the_policys_joints(tmp_path):
    renamed = ("right_hip", "right_knee", "left_hip", "left_knee")
    contract = tracker()
    wrong_names = replace(contract, joint_names=renamed, action_joint_names=renamed)
    in_graph = examined(tmp_path, in_policy_order=True).load(wrong_names).reference
    in_file = examined(tmp_path, in_policy_order=False).load(wrong_names).reference
    assert in_graph.term("reference_joint_pos", 0).tolist() == [0.0, 1.0, 2.0, 3.0]
    assert in_file.term("reference_joint_pos", 0).tolist() == [2.0, 3.0, 0.0, 1.0]
    slower = replace(contract, policy_dt=0.04)
    assert examined(tmp_path, in_policy_order=True).load(slower).reference.frame_count == 4
    assert examined(tmp_path, in_policy_order=False).load(slower).reference.frame_count == 2


def test_quaternions_of_the_graph_are_read_again_in_the_other_order(tmp_path):
    found = examined(tmp_path, in_policy_order=True)
    w, x, y, z = quaternions(found.motion_under(found.contract))
    other = quaternions(found.motion_under(replace(found.contract, reference_quaternion="xyzw")))
    # Its source gave (w, x, y, z); taken for (x, y, z, w), the last value is the scalar.
    assert other.tolist() == [z, w, x, y]
    stated = ExaminedPolicy(
        replace(found.contract, reference_quaternion="xyzw"), found.policy, found.description, found.motion, True
    )
    other = quaternions(stated.motion_under(found.contract))
    # Read as x y z w before, it was given as (x, y, z, w), which is now taken for w x y z as it stands.
    assert other.tolist() == [x, y, z, w]


def test_the_base_is_found_whatever_the_anchor_is(tmp_path):
    found = examined(tmp_path, in_policy_order=True)
    reference = found.base_reference()
    assert reference.term("anchor_pos", 0).tolist() == [8.0, 9.0, 10.0]  # pelvis, though the contract says torso


def test_a_tracking_policy_without_a_motion_is_refused():
    with pytest.raises(InputError, match="--motion: is missing"):
        load_examined(SAMPLE_POLICY, load_robot("lite"))
    found = load_examined(SAMPLE_POLICY, load_robot("lite"), motion="wave")
    assert not found.in_policy_order
    assert found.motion_seconds > 5.0
    assert found.base_reference() is None


def test_the_trainer_s_samples_tell_wiring_and_never_gains(tmp_path):
    examined = load_examined(SAMPLE_POLICY, load_robot("lite"), motion="wave")
    right = examined.contract
    assert examined.contradicts is not None
    assert not examined.contradicts(right)
    assert examined.contradicts(replace(right, action_scale=0.5 * right.action_scale))
    assert not examined.contradicts(replace(right, joint_stiffness=0.5 * right.joint_stiffness))
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("override: {terms: {joint_pos: {relative: false}}}\n")
    examined = load_examined(SAMPLE_POLICY, load_robot("lite"), wrong, "wave")
    assert examined.contradicts is None
    assert "observation joint_pos[0] (left_shoulder_pitch) is" in examined.problem
