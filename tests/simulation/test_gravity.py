import msgspec
import mujoco
import numpy as np
import pytest

from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.gravity import GravityTorque
from humanoid_sim.simulation.model import build_model
from humanoid_sim.simulation.mujoco_robot import MujocoRobot


@pytest.mark.parametrize("name", ["lite", "lite_neck"])
def test_is_the_bias_of_a_robot_at_rest(name: str) -> None:
    robot = load_robot(name)
    gravity = GravityTorque(robot)
    model = build_model(robot)
    data = mujoco.MjData(model)
    for position in np.random.default_rng(5).uniform(robot.lower, robot.upper, (20, robot.joint_count)):
        data.qpos[:] = position
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(gravity(position), data.qfrc_bias, rtol=0, atol=1e-12)


def test_is_clipped_to_the_effort_limits() -> None:
    robot = load_robot("lite")
    weak = msgspec.structs.replace(
        robot, joints=tuple(msgspec.structs.replace(joint, effort_limit=0.5) for joint in robot.joints)
    )
    torque = GravityTorque(weak)(np.zeros(14))  # a T-pose: 4.7 N·m at the shoulders
    assert torque[1] == 0.5
    assert torque[8] == -0.5


def test_holds_the_arms_still() -> None:
    """With a little damping, and nothing that pulls towards a position."""
    description = load_robot("lite")
    robot = MujocoRobot(description)
    gravity = GravityTorque(description)
    start = np.array(description.standby_controller_a.pose_segments[1])
    robot.data.qpos[:] = start
    zeros = np.zeros(14)
    for _ in range(400):
        effort = gravity(robot.qpos)
        robot.write(MITCommand(zeros, zeros, effort, zeros, np.full(14, 0.5)))
    assert np.abs(robot.qpos - start).max() < 1e-3


def test_same_input_same_bits_and_the_input_is_left_alone() -> None:
    gravity = GravityTorque(load_robot("lite"))
    position = np.linspace(-0.4, 0.0, 14)
    before = position.copy()
    first = gravity(position)
    gravity(np.zeros(14))
    assert gravity(position).tobytes() == first.tobytes()
    assert (position == before).all()
