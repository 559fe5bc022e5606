"""The Lite's legs, against the figures of the published model (Lite-Description, variant lite_biped)."""

import mujoco
import numpy as np
import pytest

from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.kinematics import ForwardKinematics
from humanoid_sim.simulation.model import build_model, joint_addresses
from humanoid_sim.simulation.mujoco_robot import MujocoRobot

ROBOT = load_robot("lite_biped")
LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee_pitch", "ankle_yaw", "ankle_pitch", "ankle_roll")
MIRROR = np.array([1, -1, -1, 1, -1, 1, -1])
HOME = [-0.1745, 0.0, 0.0, 0.3491, 0.0, -0.1745, 0.0]


def test_joints_are_in_canonical_order():
    assert ROBOT.joint_names == tuple(f"{side}_{joint}" for side in ("left", "right") for joint in LEG)
    model = build_model(ROBOT)
    assert tuple(model.joint(i).name for i in range(model.njnt)) == ("floating_base_joint", *ROBOT.joint_names)


def test_limits_and_gains():
    assert ROBOT.effort_limit.tolist() == [36, 36, 17, 36, 14, 14, 5.5] * 2
    assert ROBOT.lower[:7].tolist() == [-2.35619, -0.349066, -1.5708, 0.0, -1.5708, -0.523599, -0.349066]
    assert ROBOT.upper[:7].tolist() == [0.785398, 1.5708, 1.5708, 2.35619, 1.5708, 0.872665, 0.349066]
    mirrored = np.sort(MIRROR * np.array([ROBOT.lower[:7], ROBOT.upper[:7]]), axis=0)
    assert [ROBOT.lower[7:].tolist(), ROBOT.upper[7:].tolist()] == mirrored.tolist()
    assert set(ROBOT.stiffness) == {80.0}
    assert set(ROBOT.damping) == {2.0}


def test_motors_are_those_of_the_hardware_map():
    motors = [joint.motor for joint in ROBOT.joints if joint.motor]
    assert [motor.can_id for motor in motors] == [*range(31, 38), *range(41, 48)]
    assert [motor.bus for motor in motors] == [0] * 7 + [1] * 7
    assert [m.model for m in motors] == ["rs-06", "rs-06", "rs-02", "rs-06", "rs-00", "rs-00", "rs-05"] * 2
    assert [m.direction for m in motors] == [-1, 1, 1, -1, 1, 1, -1, 1, 1, 1, 1, 1, -1, -1]
    assert [m.torque_limit for m in motors] == ROBOT.effort_limit.tolist()


def test_mass_inertia_and_friction():
    model = build_model(ROBOT, scene=False)
    assert model.body_mass.sum() == pytest.approx(11.48, abs=1e-9)
    dof = joint_addresses(model, ROBOT.joint_names).dof
    assert model.dof_armature[dof].tolist() == [0.008, 0.008, 0.005, 0.008, 0.002, 0.002, 0.001] * 2
    assert model.dof_frictionloss[dof].tolist() == [0.1] * 14
    assert not model.dof_damping.any()


@pytest.mark.parametrize(
    ("pose", "center", "foot"),
    [
        ([0.0] * 7, [-0.0055, 0.0, -0.26766], [-0.015, 0.07, -0.71]),
        (HOME, [0.01357, 0.0, -0.26678], [-0.01806, 0.06703, -0.70406]),
    ],
)
def test_centre_of_mass_and_feet_are_where_published(pose, center, foot):
    model = build_model(ROBOT, scene=False)
    data = mujoco.MjData(model)
    data.qpos[7:] = pose * 2
    mujoco.mj_forward(model, data)
    pelvis = data.body("pelvis")
    assert pelvis.subtree_com - pelvis.xpos == pytest.approx(center, abs=1e-5)
    position, _ = ForwardKinematics(ROBOT)(np.array(pose * 2))
    assert position[0] == pytest.approx(foot, abs=2e-5)
    assert position[1] == pytest.approx(np.array([1, -1, 1]) * foot, abs=2e-5)


def test_the_right_leg_mirrors_the_left():
    left = np.random.default_rng(5).uniform(ROBOT.lower[:7], ROBOT.upper[:7], (50, 7))
    position, _ = ForwardKinematics(ROBOT)(np.concatenate([left, left * MIRROR], axis=1))
    assert position[:, 1] == pytest.approx(position[:, 0] * [1, -1, 1], abs=1e-4)


@pytest.mark.parametrize(("pose", "height"), [([0.0] * 7, 0.775), (HOME, 0.76935)])
def test_its_soles_touch_the_floor_at_the_published_height(pose, height):
    robot = MujocoRobot(ROBOT)
    robot.data.qpos[2], robot.data.qpos[7:] = height - 5e-5, pose * 2
    mujoco.mj_forward(robot.model, robot.data)
    soles = {robot.model.body(name).id for name in ROBOT.hands}
    bodies = robot.model.geom_bodyid[robot.data.contact.geom]
    touching = np.abs(robot.data.contact.dist) < 1e-4
    assert set(bodies[touching].ravel().tolist()) == {0, *soles}
    assert (robot.data.contact.dist > -1e-4).all()  # nothing overlaps, of legs and pelvis either
    robot = MujocoRobot(ROBOT)  # which starts on its feet, under its support
    assert robot.base_state.height == pytest.approx(0.76935, abs=1e-5)
    assert (robot.supported, robot.warnings) == (True, ())


@pytest.mark.parametrize("actuation", ["qfrc_applied", "affine"])
def test_it_stands_by_itself_for_ten_seconds(actuation):
    """At K_p 80 and K_d 2, held for a second and then let go on its feet."""
    robot = MujocoRobot(ROBOT, actuation=actuation, base_yaw=0.7)
    zeros = np.zeros(14)
    stand = MITCommand(np.array(ROBOT.initial_position), zeros, zeros, ROBOT.stiffness, ROBOT.damping)
    heights, tilts, efforts = [], [], []
    for tick in range(11 * 200):
        if tick == 200:
            robot.set_support(False)
        robot.write(stand)
        base = robot.base_state
        heights.append(base.height)
        tilts.append(base.tilt)
        efforts.append(np.abs(robot.read()[0].joint_effort))
    assert min(heights) > 0.765
    assert max(heights) < 0.770
    assert max(tilts) < np.deg2rad(2.0)
    assert (np.max(efforts, axis=0) < 0.3 * ROBOT.effort_limit).all()
    assert np.hypot(base.position[0], base.position[1]) < 0.02
    assert np.abs(base.linear_velocity).max() < 1e-4
    assert base.yaw == pytest.approx(0.7, abs=0.01)


def test_without_torque_it_falls():
    robot = MujocoRobot(ROBOT, support=False)
    for _ in range(300):
        robot.write(MITCommand.zeros(14))
    assert robot.base_state.height < 0.4
    assert robot.base_state.height > 0.0  # on the floor, not through it
