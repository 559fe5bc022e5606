"""Measured dynamics of joints: in place of the MJCF's, alike in one robot and in a batch."""

import numpy as np
import pytest
from msgspec.structs import replace

from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.schema import JointDynamics
from humanoid_sim.simulation.batch_sim import BatchSim
from humanoid_sim.simulation.model import build_model
from humanoid_sim.simulation.sim_robot import SimRobot

MEASURED = (
    JointDynamics(armature=0.015, friction=0.3, damping=0.1, torque_scale=0.9, delay=0.005),
    JointDynamics(armature=0.0075, friction=0.2, damping=0.05, torque_scale=1.1, delay=0.005),
)


def with_dynamics(robot, *dynamics, **fields):
    joints = (replace(joint, dynamics=own, **fields) for joint, own in zip(robot.joints, dynamics, strict=True))
    return replace(robot, joints=tuple(joints))


def followed(robot, steps=100):
    """Where the joints of a simulated robot, and of one in a batch, are, tick by tick."""
    alone, batch, places = SimRobot(robot), BatchSim(robot, 2), []
    alone.reset()
    for step in range(steps):
        goal = 0.1 * np.sin(0.05 * step + np.arange(2))
        command = MITCommand(goal, np.zeros(2), np.zeros(2), robot.stiffness, robot.damping)
        alone.write(command)
        fields = ("position", "velocity", "effort", "stiffness", "damping")
        batch.step(MITCommand(*(np.tile(getattr(command, name), (2, 1)) for name in fields)))
        assert batch.state().joint_position[1] == pytest.approx(alone.state().joint_position, abs=1e-9)
        places.append(alone.state().joint_position)
    return np.array(places)


def test_they_take_the_place_of_the_mjcf_s(small_robot):
    robot = small_robot()
    measured = with_dynamics(robot, *MEASURED)
    model = build_model(replace(measured, simulation=replace(robot.simulation, joint_damping="drop")))
    for name, own in zip(robot.joint_names, MEASURED, strict=True):
        dof = model.joint(name).dofadr[0]
        found = model.dof_armature[dof], model.dof_frictionloss[dof], model.dof_damping[dof]
        assert found == (own.armature, own.friction, own.damping)
    partly = build_model(with_dynamics(robot, JointDynamics(torque_scale=0.5), JointDynamics()))
    assert partly.dof_armature.tolist() == build_model(robot).dof_armature.tolist(), "what is not measured stays"


def test_they_change_the_motion_alike_alone_and_in_a_batch(small_robot):
    robot = small_robot()
    assert np.abs(followed(with_dynamics(robot, *MEASURED)) - followed(robot)).max() > 0.01
