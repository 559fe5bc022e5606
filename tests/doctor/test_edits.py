"""The space of single edits, on small contracts that have every kind of term."""

from dataclasses import replace

import numpy as np
import pytest
from models import contract_of
from plants import alike, at_rate, gains_listed, multiplied, no_pose, relabelled, swapped, term, terms_swapped, turned

from humanoid_sim.controllers.contract import PhaseRule, Term
from humanoid_sim.doctor.edits import asymmetry, isaac_order, single_edits
from humanoid_sim.policy.motion import Motion
from humanoid_sim.robots.description import load_robot

ROBOT = load_robot("lite_biped")
JOINTS = ROBOT.joint_names  # seven of each leg: hip pitch, roll, yaw; knee; ankle yaw, pitch, roll
MOTION = Motion(np.zeros((2, 2 * 14 + 7 * 2)), ("pelvis", "torso"), 0.02, layout="joints_bodies_w", joint_names=JOINTS)
WALKER = contract_of(
    JOINTS,
    joint_stiffness=[40.0, 99.0, 60.0, 90.0, 20.0, 21.0, 22.0] * 2,
    joint_damping=[2.0, 6.0, 3.0, 5.0, 1.0, 1.1, 1.2] * 2,
    default_joint_pos=ROBOT.initial_position,
    action_scale=[0.55, 0.35, 0.45, 0.5, 0.25, 0.3, 0.4] * 2,
    observation=[
        Term("base_lin_vel", history=3),
        Term("base_ang_vel", scale=0.25, history=3),
        Term("projected_gravity", history=3),
        Term("velocity_commands", history=3),
        Term("joint_pos", history=3),
        Term("joint_vel", scale=0.05, joints=JOINTS, history=3),
        Term("last_action", history=3),
        Term("imu_quaternion", history=3),
        Term("gait_phase", history=3),
    ],
    command_names=("twist",),
    phase=PhaseRule(0.8),
)
TRACKER = contract_of(
    JOINTS,
    task_type="tracking",
    observation=["command", "motion_anchor_pos_b", "motion_anchor_ori_b", "joint_pos", "actions"],
    command_names=("motion",),
    body_names=("pelvis", "torso"),
    anchor_body="torso",
)

PLANTS = {
    "two joints swapped": swapped("left_hip_roll", "left_hip_yaw"),
    "order of all joints": relabelled(isaac_order(ROBOT)),
    "sign of a joint": turned("right_knee_pitch"),
    "gains x 2": multiplied(2.0, "joint_stiffness", "joint_damping"),
    "action scale x 0.5": multiplied(0.5, "action_scale"),
    "default pose zero": no_pose,
    "gravity sign": term("projected_gravity", scale=-1.0),
    "quaternion order": term("imu_quaternion", quaternion="xyzw"),
    "gyro in the world frame": term("base_ang_vel", frame="world"),
    "velocity of the IMU": term("base_lin_vel", at="imu"),
    "absolute joint positions": term("joint_pos", relative=False),
    "last action scaled": term("last_action", form="scaled"),
    "two terms swapped": terms_swapped("joint_pos", "joint_vel"),
    "25 Hz": at_rate(25.0),
    "gains in another order": gains_listed(isaac_order(ROBOT)),
    "history layout": lambda contract: replace(contract, history_layout="per_step"),
    "history order": lambda contract: replace(
        contract, observation=tuple(replace(item, history_order="newest_first") for item in contract.terms)
    ),
    "the other foot first": lambda contract: replace(contract, phase=PhaseRule(0.8, offsets=np.array([np.pi, 0.0]))),
}


OF_MOTIONS = {
    "anchor body": lambda contract: replace(contract, anchor_body="pelvis"),
    "heading": lambda contract: replace(contract, align_reference=False),
    "the motion's quaternions": lambda contract: replace(contract, reference_quaternion="xyzw"),
    "column by column": term("motion_anchor_ori_b", layout="columns"),
    "inverse rotation": term("motion_anchor_ori_b", inverse=True),
    "anchor in the world frame": term("motion_anchor_pos_b", frame="world"),
    "relative command": term("command", relative=True),
}


@pytest.mark.parametrize(
    ("right", "plant"),
    [(WALKER, plant) for plant in PLANTS.values()] + [(TRACKER, plant) for plant in OF_MOTIONS.values()],
    ids=[*PLANTS, *OF_MOTIONS],
)
def test_one_edit_undoes_a_usual_mistake(right, plant):
    wrong = plant(right)
    assert not alike(wrong, right)
    assert any(alike(edit.contract, right) for edit in single_edits(wrong, ROBOT, MOTION))


def test_gains_that_break_the_symmetry_of_the_robot_are_not_proposed():
    assert asymmetry(WALKER) == 0
    gains = [edit for edit in single_edits(WALKER, ROBOT) if edit.family == "gains"]
    assert gains
    assert all(asymmetry(edit.contract) == 0 for edit in gains)
