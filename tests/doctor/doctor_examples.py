"""Small contracts that have every kind of term, for robots of four joints that do not exist."""

import numpy as np
from models import contract_of

from humanoid_sim.controllers.contract import PhaseRule, PolicyContract
from humanoid_sim.controllers.terms import Term
from humanoid_sim.doctor.edits import RobotFacts

JOINTS = ("left_hip", "left_knee", "right_hip", "right_knee")
BREADTH_FIRST = ("left_hip", "right_hip", "left_knee", "right_knee")
FACTS = RobotFacts(
    joint_names=JOINTS,
    breadth_first=BREADTH_FIRST,
    effort_limit=np.array([80.0, 60.0, 80.0, 60.0]),
    stiffness=np.array([90.0, 91.0, 92.0, 93.0]),
    damping=np.array([2.0, 3.0, 2.0, 3.0]),
    initial_position=np.array([0.1, 0.2, 0.1, 0.2]),
    motion_bodies=("pelvis", "torso"),
)


def walker() -> PolicyContract:
    return contract_of(
        BREADTH_FIRST,
        action_joint_names=("left_knee", "left_hip", "right_hip"),
        joint_stiffness=[40.0, 41.0, 42.0, 43.0],
        joint_damping=[1.0, 1.1, 1.2, 1.3],
        default_joint_pos=[-0.1, -0.2, 0.3, 0.4],
        observation=[
            Term("base_ang_vel", scale=0.25, history=3),
            Term("projected_gravity", history=3),
            Term("velocity_commands", scale=[2.0, 2.0, 0.25], history=3),
            Term("joint_pos", scale=[1.0, 2.0], joints=("right_hip", "left_hip"), history=3),
            Term("joint_vel", scale=0.0, history=3),
            Term("last_action", history=3),
            Term("imu_quaternion", history=3),
            Term("gait_phase", history=3),
        ],
        command_names=("twist",),
        command_ranges=[[-0.2, 1.0], [0.0, 0.0], [-0.3, 0.3]],
        action_scale=[0.5, 0.6, 0.7],
        phase=PhaseRule(0.7),
    )


def tracker() -> PolicyContract:
    return contract_of(
        JOINTS,
        task_type="tracking",
        joint_stiffness=[40.0, 41.0, 42.0, 43.0],
        joint_damping=[1.0, 1.1, 1.2, 1.3],
        default_joint_pos=[-0.1, -0.2, 0.3, 0.4],
        observation=[
            "command",
            "motion_anchor_pos_b",
            "motion_anchor_ori_b",
            "base_lin_vel",
            "base_ang_vel",
            "joint_pos",
            "joint_vel",
            "actions",
        ],
        command_names=("motion",),
        action_scale=[0.5, 0.6, 0.7, 0.8],
        body_names=("pelvis", "torso"),
        anchor_body="torso",
    )


CONTRACTS = {"walker": walker, "tracker": tracker}
