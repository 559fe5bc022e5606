"""The shipped robots: their models against golden figures, their tables, and poses that touch nothing."""

import json
from itertools import pairwise
from pathlib import Path

import msgspec
import mujoco
import numpy as np
import pytest

from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.kinematics import ForwardKinematics
from humanoid_sim.simulation.model import build_model, joint_addresses

GOLDEN = json.loads(Path(__file__).parent.parent.joinpath("data", "lite_arms_golden.json").read_text())
ROBOTS = ("lite", "lite_neck")

ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow_pitch", "wrist_yaw", "wrist_roll", "wrist_pitch")
NAMES = (
    *(f"left_{joint}" for joint in ARM),
    *(f"right_{joint}" for joint in ARM),
    "neck_yaw",
    "neck_roll",
    "neck_pitch",
)

LOWER = [-3.14159, -1.5708, -1.5708, -2.35619, -1.5708, -0.698132, -0.785398]
UPPER = [0.785398, 1.91986, 1.5708, 0.0, 1.5708, 0.698132, 0.785398]
RIGHT_LOWER = [-3.14159, -1.91986, *LOWER[2:]]
RIGHT_UPPER = [0.785398, 1.5708, *UPPER[2:]]
NECK = [0.785398, 0.523599, 0.523599]

POSE_A = [0.3, -1.0, 0, -1.7, -1.2, 0, 0.3, 0.3, 1.0, 0, -1.7, 1.2, 0, -0.3]


@pytest.fixture(params=ROBOTS)
def robot(request):
    return load_robot(request.param)


def names_of(robot):
    return NAMES[: 17 if robot.name == "lite_neck" else 14]


def test_joints_are_in_canonical_order(robot):
    assert robot.joint_names == names_of(robot)
    model = build_model(robot, scene=False)
    assert tuple(model.joint(i).name for i in range(model.njnt)) == names_of(robot)
    assert joint_addresses(model, robot.joint_names).qpos.tolist() == list(range(robot.joint_count))


def test_motors_are_those_of_the_hardware_map():
    robot = load_robot("lite_neck")
    motors = [joint.motor for joint in robot.joints]
    assert all(motor is not None for motor in motors)
    assert [m.can_id for m in motors if m] == [*range(11, 18), *range(21, 28), 31, 32, 33]
    assert [m.bus for m in motors if m] == [0] * 7 + [1] * 7 + [0] * 3
    arm = ["rs-02", "rs-00", "rs-00", "rs-00", "rs-05", "rs-05", "rs-05"]
    assert [m.model for m in motors if m] == [*arm, *arm, "rs-00", "rs-00", "rs-00"]
    assert [m.direction for m in motors if m] == [-1, -1, 1, -1, 1, -1, -1, 1, -1, 1, 1, 1, 1, -1, 1, 1, 1]
    arm_torque, arm_current = [17.0, 14.0, 14.0, 14.0, 4.0, 4.0, 4.0], [27.0, 16.0, 16.0, 16.0, 14.0, 14.0, 14.0]
    assert robot.effort_limit.tolist() == [*arm_torque, *arm_torque, 10.0, 10.0, 10.0]
    assert [m.torque_limit for m in motors if m] == robot.effort_limit.tolist()
    assert [m.current_limit for m in motors if m] == [*arm_current, *arm_current, 14.0, 14.0, 14.0]
    assert robot.stiffness.tolist() == [50.0] * 14 + [30.0] * 3
    assert robot.damping.tolist() == [2.0] * 14 + [1.0] * 3


def test_settings(robot):
    assert (robot.simulation.physics_timestep, robot.simulation.control_frequency) == (0.0005, 200.0)
    assert (robot.hardware.control_frequency, robot.hardware.rx_timeout_ms) == (50.0, 200.0)
    assert robot.damping_controller.damping_scalar == robot.remote_policy_controller.damping_scalar == 5.0
    zeros = (0.0,) * robot.joint_count
    for standby in (robot.standby_controller_a, robot.standby_controller_b):
        assert standby.segment_durations == (2.0, 2.0)
        assert standby.pose_segments[0] == zeros
        assert list(standby.target_stiffness) == robot.stiffness.tolist()
        assert list(standby.target_damping) == robot.damping.tolist()
    assert list(robot.standby_controller_a.pose_segments[1][:14]) == POSE_A
    pose_b = np.array(robot.standby_controller_b.pose_segments[1])
    assert np.abs(pose_b[:14] - POSE_A).max() > 0.5


def test_joint_ranges_are_radians():
    """A model read in degrees would have a shoulder of ±3°."""
    model = mujoco.MjModel.from_xml_path(str(load_robot("lite_neck").mjcf_path))
    assert model.jnt_range[:, 0].tolist() == [*LOWER, *RIGHT_LOWER, *(-limit for limit in NECK)]
    assert model.jnt_range[:, 1].tolist() == [*UPPER, *RIGHT_UPPER, *NECK]
    assert model.jnt_limited.all()
    built = build_model(load_robot("lite_neck"))
    assert (built.jnt_range == model.jnt_range).all()


def test_masses_and_motors_are_the_published_ones(robot):
    model = mujoco.MjModel.from_xml_path(str(robot.mjcf_path))
    assert model.body_mass.sum() == pytest.approx(13.692339, abs=1e-9)
    assert model.body("left_shoulder_roll").mass[0] == 0.42
    assert model.body("right_shoulder_roll").mass[0] == 0.42073
    assert model.dof_frictionloss.tolist() == [0.1] * model.nv
    assert model.dof_damping.tolist() == [0.0] * model.nv
    armature = [0.005, *[0.002] * 6]
    assert model.dof_armature.tolist() == [*armature, *armature, 0.01, 0.01, 0.01][: model.nv]


def test_golden(robot):
    """Poses, inertia and gravity torques of the reference model at 20 configurations, to its stated tolerance.

    With a rigid neck the arms are unchanged, so the golden figures hold for the first 14 joints.
    """
    model = build_model(robot)
    data = mujoco.MjData(model)
    mass = np.empty((model.nv, model.nv))
    assert len(GOLDEN["samples"]) == 20
    for sample in GOLDEN["samples"]:
        data.qpos[:] = sample["q"][: model.nq]
        mujoco.mj_forward(model, data)
        for hand in ("left_hand", "right_hand"):
            np.testing.assert_allclose(data.body(hand).xpos, sample[hand]["pos"], rtol=0, atol=1e-9)
            np.testing.assert_allclose(data.site(hand).xpos, sample[hand]["pos"], rtol=0, atol=1e-9)
            cosine = abs(data.body(hand).xquat @ np.array(sample[hand]["quat"]))
            assert cosine == pytest.approx(1.0, abs=1e-12)
        for tip in ("left_finger2_tip", "right_finger2_tip"):
            np.testing.assert_allclose(data.site(tip).xpos, sample[tip]["pos"], rtol=0, atol=1e-9)
        mujoco.mj_fullM(model, data, mass)
        np.testing.assert_allclose(np.diag(mass), sample["mass_matrix_diag"][: model.nv], rtol=1e-7, atol=0)
        np.testing.assert_allclose(data.qfrc_bias, sample["qfrc_bias"][: model.nv], rtol=0, atol=1e-7)


def touching(model, data, position):
    data.qpos[:] = position
    mujoco.mj_forward(model, data)
    return [
        " and ".join(model.body(model.geom_bodyid[geom]).name for geom in (contact.geom1, contact.geom2))
        for contact in data.contact[: data.ncon]
    ]


def test_poses_and_the_ways_to_them_touch_nothing(robot):
    model = build_model(robot)
    data = mujoco.MjData(model)
    for standby in (robot.standby_controller_a, robot.standby_controller_b):
        way = [np.array(robot.initial_position), *(np.array(pose) for pose in standby.pose_segments)]
        for start, end in pairwise(way):
            for share in np.linspace(0.0, 1.0, 201):
                assert touching(model, data, start + share * (end - start)) == []
        # After DAMP the next standby starts wherever the joints are: check the way back as well.
        for share in np.linspace(0.0, 1.0, 201):
            assert touching(model, data, way[-1] * (1.0 - share)) == []
    across_the_chest = np.zeros(robot.joint_count)
    across_the_chest[[0, 1, 3]] = -1.5, -1.2, -2.3
    assert touching(model, data, across_the_chest), "the check can fail"


def test_the_robot_starts_at_rest_without_torque(robot):
    """Friction holds the hanging arms (and the head) where they are: ZERO_TORQUE looks calm from the first tick."""
    model = build_model(robot)
    data = mujoco.MjData(model)
    start = np.array(robot.initial_position)
    assert (start > robot.lower).all()
    assert (start < robot.upper).sum() == robot.joint_count
    data.qpos[:] = start
    mujoco.mj_forward(model, data)
    assert np.abs(data.qfrc_bias).max() < 0.1  # the friction loss of every joint
    for _ in range(6000):
        mujoco.mj_step(model, data)
    assert np.abs(data.qpos - start).max() < np.deg2rad(1.0)
    assert np.abs(data.qvel).max() < 0.01


def test_arms_hang_beside_the_torso():
    robot = load_robot("lite")
    position, _ = ForwardKinematics(robot)(np.array(robot.initial_position))
    left, right = position
    assert left[2] < 0.05  # the shoulders are at 0.39 m
    np.testing.assert_allclose(left * [1, -1, 1], right, atol=1e-4)
    # Nor does a straight arm reach the floor: 0.39 m from shoulder to wrist, 0.24 m from there to the fingertip.
    assert robot.simulation.floor_height < 0.39 - 0.39 - 0.24


def test_sites_and_looks(robot):
    model = build_model(robot)
    for site in ("imu", "left_hand", "right_hand", "left_finger2_tip", "right_finger2_tip"):
        assert mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, site) >= 0
    visual = model.geom_group == 2
    assert visual.sum() > 80
    assert not model.geom_contype[visual].any()
    assert not model.geom_conaffinity[visual].any()
    colliding = {model.body(model.geom_bodyid[i]).name for i in np.flatnonzero(model.geom_contype)}
    assert colliding == {
        "world", "chest", "head",
        "left_shoulder_yaw", "left_wrist_yaw", "left_hand",
        "right_shoulder_yaw", "right_wrist_yaw", "right_hand",
    }  # fmt: skip


def test_the_lite_is_the_original_s():
    lite = load_robot("lite")
    assert (lite.hardware.control_frequency, lite.simulation.control_frequency) == (50.0, 200.0)
    for standby in (lite.standby_controller_a, lite.standby_controller_b):
        assert standby.segment_durations == (2.0, 2.0)
        assert standby.pose_segments[0] == (0.0,) * 14
    a, b = (msgspec.structs.asdict(one) for one in (lite.standby_controller_a, lite.standby_controller_b))
    assert {name for name in a if a[name] != b[name]} == {"pose_segments"}
    ready = (0.3, -1.0, 0.0, -1.7, -1.2, 0.0, 0.3, 0.3, 1.0, 0.0, -1.7, 1.2, 0.0, -0.3)
    assert lite.standby_controller_a.pose_segments[1] == ready
