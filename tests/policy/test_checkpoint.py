"""The policy that runs where there is none."""

import pytest

from humanoid_sim.policy.checkpoint import placeholder_checkpoint
from humanoid_sim.robots.description import load_robot


@pytest.mark.parametrize("pose", ["a", "b"])
def test_it_holds_the_pose_that_it_starts_from(pose):
    robot = load_robot("lite_neck")
    checkpoint = placeholder_checkpoint(robot, pose)
    standby = robot.standby_controller_a if pose == "a" else robot.standby_controller_b
    contract = checkpoint.contract
    assert contract.default_joint_pos.tolist() == list(standby.pose_segments[-1])
    assert contract.joint_names == contract.action_joint_names == robot.joint_names
    assert contract.joint_stiffness.tolist() == robot.stiffness.tolist()
    assert checkpoint.following().layout.width == 3 * robot.joint_count
