"""The Unitree G1, a robot from outside: described by its MJCF, walking under a published policy.

The files are not part of the project; `HUMANOID_SIM_POLICIES` says where they are.
"""

import mujoco
import numpy as np
import pytest
from published import POLICIES

from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.robots.description import load_robot, with_contract
from humanoid_sim.simulation.model import SimConfig
from humanoid_sim.simulation.sim_robot import SimRobot

MODELS = POLICIES / "models" / "unitree_g1"
VELOCITY = POLICIES / "unitree_g1_velocity_v0"

pytestmark = pytest.mark.skipif(not MODELS.is_dir(), reason=f"no published policies at {POLICIES}")


@pytest.fixture(scope="module")
def checkpoint():
    pytest.importorskip("onnxruntime")
    joints = load_robot(MODELS / "scene.xml").joint_names
    return load_checkpoint(VELOCITY / "exported" / "policy.onnx", robot_joints=joints)


@pytest.fixture(scope="module")
def g1(checkpoint):
    return with_contract(load_robot(MODELS / "scene.xml"), checkpoint.contract)


def test_gyro_and_gravity_are_those_of_the_published_trace(g1):
    trace = np.load(VELOCITY / "trace.npz")
    robot, rotation = SimRobot(g1), np.empty(9)
    for qpos, qvel, observation in zip(trace["qpos"], trace["qvel"], trace["obs"], strict=True):
        robot.reset(qpos, qvel)
        mujoco.mju_quat2Mat(rotation, robot.state().imu_quaternion)
        assert robot.state().imu_angular_velocity == pytest.approx(observation[:3], abs=1e-6)
        assert -rotation[6:] == pytest.approx(observation[3:6], abs=1e-6)


def test_it_stands_on_its_soles_at_the_start(g1):
    robot = SimRobot(g1)
    assert robot.base.height == pytest.approx(0.7842, abs=1e-4)
    assert robot.warnings == ()


def test_without_armature_the_step_is_refused_and_one_that_works_is_named(checkpoint):
    robot = with_contract(load_robot(MODELS / "robot.xml"), checkpoint.contract)
    with pytest.raises(InputError, match=r"at right_ankle_roll_joint .* unstable above 2; use a step of less than"):
        SimRobot(robot)
    assert SimRobot(robot, SimConfig(physics_timestep=0.00025)).physics_steps == 20
