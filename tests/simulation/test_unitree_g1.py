"""The Unitree G1, a robot from outside: described by its MJCF, walking under a published policy.

The files are not part of the project; `HUMANOID_SIM_POLICIES` says where they are.
"""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from published import POLICIES

from humanoid_sim.controllers.reference import no_reference
from humanoid_sim.controllers.rl_policy import RLPolicyController, RLPolicyMemory
from humanoid_sim.errors import InputError
from humanoid_sim.messages import TickInput
from humanoid_sim.mit import VELOCITY_COMMAND, Extern
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
    with pytest.raises(InputError, match=r"at right_ankle_roll_joint .* unstable above 2, .* such as 0\.00025 s$"):
        SimRobot(robot)
    assert SimRobot(robot, SimConfig(physics_timestep=0.00025)).physics_steps == 20


@pytest.mark.parametrize("timestep", [0.005, 0.001])
def test_it_walks_as_published(g1, checkpoint, timestep):
    """Told 0.5 m/s it makes 0.427 ± 0.015; published over 20 s, here over the first 6."""
    config = SimConfig(control_period=0.02, physics_timestep=timestep, support=False)
    robot = SimRobot(g1, config)
    controller = RLPolicyController(
        joints=robot.joints,
        contract=checkpoint.contract,
        reference=no_reference(),
        policy=checkpoint.policy,
        control_period=0.02,
        extern={**robot.extern, VELOCITY_COMMAND: 3},
    )
    memory = None
    velocity, height, tilt = [], [], []
    while robot.time < 6.0:
        state, safety = robot.read()
        command = Extern(np.array([0.5, 0.0, 0.0]), state.time)
        tick = TickInput(state=replace(state, extern={**state.extern, VELOCITY_COMMAND: command}), safety=safety)
        if memory is None:
            activated = controller.activate(tick)
            assert isinstance(activated, RLPolicyMemory)
            memory = activated
        result = controller.update(memory, tick)
        assert isinstance(result, tuple), result
        memory = result[0]
        robot.write(result[1])
        base = robot.base
        height.append(base.height)
        tilt.append(base.tilt)
        if robot.time >= 2.0:
            velocity.append(base.planar_velocity)
    assert np.mean(velocity, axis=0)[0] == pytest.approx(0.427, abs=0.015)
    assert np.mean(velocity, axis=0)[1] == pytest.approx(0.0, abs=0.02)
    assert min(height) > 0.775
    assert max(height) < 0.79
    assert np.mean(height) == pytest.approx(0.783, abs=0.001)
    assert max(tilt) < np.deg2rad(4.0)
