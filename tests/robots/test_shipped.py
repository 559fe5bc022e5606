"""The shipped robots, motors and pianos against published figures, and poses that touch nothing."""

import json
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest

from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.motors import FAMILIES, MOTORS, id_problem
from humanoid_sim.robots.piano import TRIGGER, key_joint_names
from humanoid_sim.simulation.model import build_model, joint_addresses

DATA = Path(__file__).parents[1] / "data"
GOLDEN, PIANOS = (json.loads((DATA / f"{name}.json").read_text()) for name in ("lite_arms_golden", "piano"))
ARMS = pytest.mark.parametrize("robot", [load_robot("lite"), load_robot("lite_neck")], ids=lambda robot: robot.name)
BIPED = load_robot("lite_biped")
ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow_pitch", "wrist_yaw", "wrist_roll", "wrist_pitch")
LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee_pitch", "ankle_yaw", "ankle_pitch", "ankle_roll")
NECK = ("neck_yaw", "neck_roll", "neck_pitch")
LOWER = [-3.14159, -1.5708, -1.5708, -2.35619, -1.5708, -0.698132, -0.785398]
UPPER = [0.785398, 1.91986, 1.5708, 0.0, 1.5708, 0.698132, 0.785398]
MIRROR = np.array([1, -1, -1, 1, -1, 1, -1])
READY = (0.3, -1.0, 0.0, -1.7, -1.2, 0.0, 0.3, 0.3, 1.0, 0.0, -1.7, 1.2, 0.0, -0.3)


def sides(joints):
    return [f"{side}_{joint}" for side in ("left", "right") for joint in joints]


@pytest.mark.parametrize(
    ("name", "joints", "ids", "models", "directions", "efforts"),
    [
        (
            "lite_neck",
            [*sides(ARM), *NECK],
            [*range(11, 18), *range(21, 28), 31, 32, 33],
            ["rs-02", "rs-00", "rs-00", "rs-00", "rs-05", "rs-05", "rs-05"] * 2 + ["rs-00"] * 3,
            [-1, -1, 1, -1, 1, -1, -1, 1, -1, 1, 1, 1, 1, -1, 1, 1, 1],
            [17.0, 14.0, 14.0, 14.0, 4.0, 4.0, 4.0] * 2 + [10.0] * 3,
        ),
        (
            "lite_biped",
            sides(LEG),
            [*range(31, 38), *range(41, 48)],
            ["rs-06", "rs-06", "rs-02", "rs-06", "rs-00", "rs-00", "rs-05"] * 2,
            [-1, 1, 1, -1, 1, 1, -1, 1, 1, 1, 1, 1, -1, -1],
            [36.0, 36.0, 17.0, 36.0, 14.0, 14.0, 5.5] * 2,
        ),
    ],
)
def test_joints_and_motors_are_those_of_the_hardware_map(name, joints, ids, models, directions, efforts):
    robot = load_robot(name)
    motors = [joint.motor for joint in robot.joints]
    assert list(robot.joint_names) == joints
    assert [motor.can_id for motor in motors] == ids
    assert [motor.bus for motor in motors] == ([0] * 7 + [1] * 7 + [0] * 3)[: len(ids)]
    assert [motor.model for motor in motors] == models
    assert [motor.direction for motor in motors] == directions
    assert [motor.torque_limit for motor in motors] == robot.effort_limit.tolist() == efforts


def test_the_lite_is_the_original_s():
    lite = load_robot("lite")
    assert (lite.hardware.control_frequency, lite.hardware.rx_timeout_ms) == (50.0, 200.0)
    assert (lite.simulation.control_frequency, lite.simulation.physics_timestep) == (200.0, 0.0005)
    assert lite.mode_damping.tolist() == lite.passive_damping.tolist() == [5.0] * 14
    for standby in (lite.standby_controller_a, lite.standby_controller_b):
        assert (standby.segment_durations, standby.pose_segments[0]) == ((2.0, 2.0), (0.0,) * 14)
        assert (standby.target_stiffness, standby.target_damping) == ((50.0,) * 14, (2.0,) * 14)
    assert lite.standby_controller_a.pose_segments[1] == READY
    assert np.abs(np.subtract(lite.standby_controller_b.pose_segments[1], READY)).max() > 0.5


def test_ranges_masses_and_dynamics_are_the_published_ones():
    arms = mujoco.MjModel.from_xml_path(str(load_robot("lite").mjcf_path))
    right = [-1.91986, 1.5708]  # of the roll, which mirrors the left one
    assert arms.jnt_range[:, 0].tolist() == [*LOWER, LOWER[0], right[0], *LOWER[2:]]
    assert arms.jnt_range[:, 1].tolist() == [*UPPER, UPPER[0], right[1], *UPPER[2:]]
    assert arms.body_mass.sum() == pytest.approx(13.692339, abs=1e-9)
    assert arms.dof_armature.tolist() == [0.005, *[0.002] * 6] * 2
    assert (set(arms.dof_frictionloss), set(arms.dof_damping)) == ({0.1}, {0.0})
    legs = build_model(BIPED, scene=False)
    dof = joint_addresses(legs, BIPED.joint_names).dof
    assert legs.body_mass.sum() == pytest.approx(11.48, abs=1e-9)
    assert legs.dof_armature[dof].tolist() == [0.008, 0.008, 0.005, 0.008, 0.002, 0.002, 0.001] * 2
    assert (set(legs.dof_frictionloss[dof]), set(legs.dof_damping)) == ({0.1}, {0.0})
    assert BIPED.lower[:7].tolist() == [-2.35619, -0.349066, -1.5708, 0.0, -1.5708, -0.523599, -0.349066]
    assert BIPED.upper[:7].tolist() == [0.785398, 1.5708, 1.5708, 2.35619, 1.5708, 0.872665, 0.349066]
    mirrored = np.sort(MIRROR * np.array([BIPED.lower[:7], BIPED.upper[:7]]), axis=0)
    assert [BIPED.lower[7:].tolist(), BIPED.upper[7:].tolist()] == mirrored.tolist()


@ARMS
def test_poses_inertia_and_gravity_of_the_arms_are_the_reference_models(robot):
    """At 20 configurations, to its stated tolerance. With a rigid neck the figures hold for the first 14 joints."""
    model = build_model(robot)
    data, mass = mujoco.MjData(model), np.empty((model.nv, model.nv))
    assert len(GOLDEN["samples"]) == 20
    for sample in GOLDEN["samples"]:
        data.qpos[:] = sample["q"][: model.nq]
        mujoco.mj_forward(model, data)
        for hand in ("left_hand", "right_hand"):
            np.testing.assert_allclose(data.body(hand).xpos, sample[hand]["pos"], rtol=0, atol=1e-9)
            cosine = abs(data.body(hand).xquat @ np.array(sample[hand]["quat"]))
            assert cosine == pytest.approx(1.0, abs=1e-12)
        for tip in ("left_finger2_tip", "right_finger2_tip"):
            np.testing.assert_allclose(data.site(tip).xpos, sample[tip]["pos"], rtol=0, atol=1e-9)
        mujoco.mj_fullM(model, data, mass)
        np.testing.assert_allclose(np.diag(mass), sample["mass_matrix_diag"][: model.nv], rtol=1e-7, atol=0)
        np.testing.assert_allclose(data.qfrc_bias, sample["qfrc_bias"][: model.nv], rtol=0, atol=1e-7)


def touches(model, data, position):
    data.qpos[:] = position
    mujoco.mj_forward(model, data)
    return data.ncon > 0


@ARMS
def test_poses_and_the_ways_to_them_touch_nothing(robot):
    model = build_model(robot)
    data, shares = mujoco.MjData(model), np.linspace(0.0, 1.0, 201)
    for standby in (robot.standby_controller_a, robot.standby_controller_b):
        way = [np.array(robot.initial_position), *(np.array(pose) for pose in standby.pose_segments)]
        for start, end in (*pairwise(way), (way[-1], 0.0 * way[-1])):  # after DAMP the next begins from anywhere
            assert not any(touches(model, data, start + share * (end - start)) for share in shares)
    across_the_chest = np.zeros(robot.joint_count)
    across_the_chest[[0, 1, 3]] = -1.5, -1.2, -2.3
    assert touches(model, data, across_the_chest), "the check can fail"


@pytest.mark.parametrize(("robot", "name"), [("lite_piano", "dep20"), ("lite_piano_nikomaku", "nikomaku")])
def test_keys_and_body_of_the_shipped_mjcf_are_the_published_ones(robot, name):
    model, data = build_model(load_robot(robot)), PIANOS[name]
    assert load_robot(robot).joints == load_robot("lite").joints
    assert key_joint_names() == tuple(key["joint"] for key in data["keys"])
    for key in data["keys"]:
        joint, body = model.joint(key["joint"]), model.body(key["body"])
        assert joint.range == pytest.approx(key["range"], abs=1e-11)
        assert TRIGGER * joint.range[1] == pytest.approx(key["trigger_angle"], abs=1e-11)
        assert joint.pos == pytest.approx(key["joint_pos"], abs=1e-11)
        assert body.pos == pytest.approx(key["pos"], abs=1e-11)
        assert body.mass[0] == pytest.approx(key["mass"], abs=1e-11)
        assert model.geom(key["body"]).size == pytest.approx(key["size"], abs=1e-11)
        found = joint.stiffness[0], joint.damping[0], model.qpos_spring[joint.qposadr[0]], joint.armature[0]
        assert found == pytest.approx([key[name] for name in ("stiffness", "damping", "springref", "armature")])
    for geom, box in zip(("piano_rear", "piano_under"), data["boxes"], strict=True):
        assert model.geom(geom).pos == pytest.approx(box["pos"], abs=1e-11)
        assert model.geom(geom).size == pytest.approx(box["size"], abs=1e-11)


def test_ranges_are_the_tables():
    models = json.loads((DATA / "actuators.json").read_text(encoding="utf-8"))["models"]
    assert {model["model"] for model in models} == {m.name for m in MOTORS.values() if m.family == "robstride"}
    for model in models:
        limits, motor = model["mit_limits"], MOTORS[model["model"]]
        assert (motor.stiffness, motor.damping) == (limits["kp"], limits["kd"])
        assert (motor.velocity, motor.effort) == (limits["velocity"], limits["torque"])


def test_ids_of_one_family_that_the_others_frames_could_address():
    robstride, sito, both = FAMILIES["robstride"], FAMILIES["sito"], {"robstride", "sito"}
    assert [i for i in range(256) if id_problem(robstride, i, {"robstride"})] == [0, *range(128, 256)]
    assert [i for i in range(128) if id_problem(robstride, i, both)] == [0, 1, 9, 69]
    assert [i for i in range(257) if id_problem(sito, i, {"sito"})] == [0, 256]
    assert [i for i in range(256) if id_problem(sito, i, both)] == [0, *range(128, 256)]
