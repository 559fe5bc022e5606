"""Measured dynamics of joints act alike in every plant, in batches and in emulated motors."""

import msgspec
import numpy as np
import pytest
from planted_arm import PERIOD, TRUTH, arm, motion, planted

from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.schema import JointDynamics, RobotDescription
from humanoid_sim.simulation.batch_sim import BatchSim
from humanoid_sim.simulation.model import SimConfig, build_model
from humanoid_sim.simulation.sim_robot import SimRobot


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    return arm(tmp_path_factory.mktemp("arm"))


def followed(robot, goals):
    """Where the joints of a simulated robot are, tick by tick."""
    simulated, zeros, places = SimRobot(robot, SimConfig(control_period=PERIOD)), np.zeros(2), []
    for goal in goals:
        simulated.write(MITCommand(goal, zeros, zeros, robot.stiffness, robot.damping))
        places.append(simulated.read()[0].joint_position)
    return np.array(places)


def test_they_take_the_place_of_the_mjcf_s(robot):
    dropped = msgspec.structs.replace(
        planted(robot), simulation=msgspec.structs.replace(robot.simulation, joint_damping="drop")
    )
    model = build_model(dropped)
    for name, own in zip(robot.joint_names, TRUTH, strict=True):
        dof = model.joint(name).dofadr[0]
        found = model.dof_armature[dof], model.dof_frictionloss[dof], model.dof_damping[dof]
        assert found == (own.armature, own.friction, own.damping)
    partly = planted(robot, (JointDynamics(torque_scale=0.5), JointDynamics()))
    assert (build_model(partly).dof_armature == build_model(robot).dof_armature).all(), "what is not measured stays"


def test_one_robot_and_a_batch_agree(robot):
    prompt = tuple(msgspec.structs.replace(own, delay=0.0) for own in TRUTH)
    truth, goals = planted(robot, prompt), motion(1.0)
    reference = followed(truth, goals)
    batch, zeros, places = BatchSim(truth, 2, SimConfig(control_period=PERIOD)), np.zeros((2, 2)), []
    gains = [np.tile(gain, (2, 1)) for gain in (truth.stiffness, truth.damping)]
    for goal in goals:
        batch.step(MITCommand(np.tile(goal, (2, 1)), zeros, zeros, *gains))
        places.append(batch.state().joint_position[1])
    assert np.array(places) == pytest.approx(reference, abs=1e-6)
    assert np.abs(followed(robot, goals) - reference).max() > 0.01


def test_a_weaker_motor_with_higher_gains_is_the_same(robot):
    weak = planted(robot, (JointDynamics(torque_scale=0.5), JointDynamics(torque_scale=0.5)))
    joints = tuple(
        msgspec.structs.replace(joint, stiffness=2.0 * joint.stiffness, damping=2.0 * joint.damping)
        for joint in weak.joints
    )
    goals = 0.2 * motion(0.5)
    stronger = msgspec.structs.replace(weak, joints=joints)
    assert followed(stronger, goals) == pytest.approx(followed(robot, goals), abs=1e-9)


def test_a_recording_keeps_them_and_a_file_says_them_by_joint(robot, tmp_path):
    text = planted(robot).to_json()
    assert RobotDescription.from_json(text, robot.folder).joints[0].dynamics == TRUTH[0]
    assert "dynamics" not in robot.to_json(), "where there are none"
    path = tmp_path / "fitted.yaml"
    path.write_text(f"mjcf: {robot.mjcf_path}\njoints:\n  elbow: {{dynamics: {{friction: 0.2, delay: 0.004}}}}\n")
    assert load_robot(path).joints[1].dynamics == JointDynamics(friction=0.2, delay=0.004)
