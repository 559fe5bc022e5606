import numpy as np
import pytest

from humanoid_sim.policy.checkpoint import placeholder_checkpoint, zero_policy
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.robots.description import load_robot


def test_it_answers_zeros_that_nobody_can_change():
    action = np.asarray(zero_policy(3)(np.ones(5, dtype=np.float32), 9))
    assert action.tolist() == [0.0, 0.0, 0.0]
    assert action.dtype == np.float32
    assert not action.flags.writeable


@pytest.mark.parametrize("robot", ["lite", "lite_neck"])
@pytest.mark.parametrize("pose", ["a", "b"])
def test_it_holds_the_pose_that_it_starts_from(robot, pose):
    description = load_robot(robot)
    checkpoint = placeholder_checkpoint(description, pose)
    contract = checkpoint.contract
    standby = description.standby_controller_a if pose == "a" else description.standby_controller_b
    assert contract.default_joint_pos.tolist() == list(standby.pose_segments[-1])
    assert contract.joint_names == contract.action_joint_names == description.joint_names
    assert contract.joint_stiffness.tolist() == description.stiffness.tolist()
    assert contract.joint_damping.tolist() == description.damping.tolist()
    assert (checkpoint.source, checkpoint.sha256, checkpoint.observation_width) == ("placeholder", "", None)
    assert load_policy(contract, checkpoint.policy, None).layout.width == 3 * description.joint_count
