"""Rows of the table by hand."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from models import contract_of

from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.controllers.rotation import multiply, rotation_6d
from humanoid_sim.evaluation.feet import Feet
from humanoid_sim.evaluation.step import StepContext, StepSample
from humanoid_sim.evaluation.step_metrics import METRICS, describe_failure, has_fallen, quaternion_angle
from humanoid_sim.mit import ANCHOR_POSE, KEY_PRESSED, Extern, MITState
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.floating_base import BaseState

ROBOT = load_robot("lite_biped")
N = ROBOT.joint_count
BASE = BaseState(
    position=np.array([0.0, 0.0, 0.7]),
    quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
    linear_velocity=np.array([0.4, 0.0, 0.2]),
    angular_velocity=np.array([0.1, 0.2, 0.3]),
    centre_of_mass=np.array([0.0, 0.0, 0.6]),
    floor=np.array(0.0),
)


def about(angle, axis):
    return np.array([np.cos(angle / 2), *(np.sin(angle / 2) * np.array(axis))])


def sample(n=N, extern=None, position=None, **changes):
    return StepSample(
        state=replace(
            MITState.unknown(n), joint_position=np.zeros(n) if position is None else position, extern=extern or {}
        ),
        action=np.full(n, 0.5, np.float32),
        previous_action=np.full(n, 0.25, np.float32),
        torque=np.full(n, 2.0),
        frame=1,
        step=1,
        command=np.array([0.5, 0.0, 0.1]),
        **changes,
    )


@pytest.fixture(scope="module")
def walker():
    contract = contract_of(ROBOT.joint_names, default_joint_pos=ROBOT.initial_position)
    return StepContext(ROBOT, contract, MotionReference(1, {}), standing_height=0.6)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("velocity_error", 0.1),
        ("yaw_rate_error", 0.2),
        ("linear_velocity", np.exp(-(0.1**2) / 0.25**2)),
        ("vertical_velocity", 0.04),
        ("rocking", 0.05),
        ("lean", 0.0),
        ("tilt", 0.0),
        ("fallen", 0.0),
        ("effort", 2.0),
        ("action_change", N * 0.0625),
        ("power", 0.0),
    ],
)
def test_a_walking_robot(walker, name, expected):
    assert METRICS[name].values(walker, sample(base=BASE)) == pytest.approx(expected, abs=1e-12)


def test_a_fall_is_a_tilt_of_more_than_1_rad_or_less_than_six_tenths_of_the_height(walker):
    tilt, mass = np.array([0.0, 0.0, 0.0, 0.99, 1.01]), np.zeros((5, 3))
    mass[:, 2] = [0.8, 0.49, 0.47, 0.8, 0.8]
    bases = replace(BASE, quaternion=np.stack([about(angle, (1.0, 0.0, 0.0)) for angle in tilt]), centre_of_mass=mass)
    assert has_fallen(bases, 0.8).tolist() == [False, False, True, False, True]
    assert has_fallen(bases, np.array([0.8, 0.9, 0.7, 0.8, 0.8])).tolist() == [False, True, False, False, True]
    step = sample(base=replace(BASE, centre_of_mass=np.array([0.0, 0.0, 0.3])))
    assert METRICS["fallen"].values(walker, step) == 1.0
    assert describe_failure(walker, step).startswith("fell: tilted by 0°, its centre of mass at 50% ")


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.0, np.pi])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_angle_between_quaternions_is_exact_from_tiny_to_half_a_turn(angle, sign):
    start = about(0.7, (0.0, 0.6, 0.8))
    other = sign * multiply(start, about(angle, (0.6, 0.0, 0.8)))
    assert quaternion_angle(start, other) == pytest.approx(angle, rel=1e-6, abs=1e-15)


def test_joints_at_their_stops_and_at_their_effort_limit(walker):
    q = 0.5 * (ROBOT.lower + ROBOT.upper)
    q[0], q[1] = ROBOT.lower[0] + 0.02, ROBOT.upper[1] + 0.01
    step = replace(sample(position=q), torque=0.9 * np.array(ROBOT.effort_limit))
    assert METRICS["joint_stops"].values(walker, step) == pytest.approx(0.03 + 0.06)
    assert METRICS["effort_share"].values(walker, step) == pytest.approx(N * 0.81)


def test_bodies_of_a_motion():
    robot, hands = load_robot("lite"), ("left_hand", "right_hand")
    contract = contract_of(robot.joint_names, task_type="tracking", body_names=hands, command_names=("motion",))
    target = np.tile(rotation_6d(np.eye(3)), (2, 2))
    reference = MotionReference(2, {"motion_body_pos_b": np.zeros((2, 6)), "motion_body_ori_b": target})
    context = StepContext(robot, contract, reference)
    position = np.array([[0.03, 0.0, 0.04], [0.0, 0.0, 0.0]])
    turn = (0.0, 0.0, 1.0)
    step = sample(14, body_position=position, body_quaternion=np.stack([about(0.2, turn), -about(0.0, turn)]))
    values = {name: METRICS[name].values(context, step) for name in METRICS if METRICS[name].needs == "motion"}
    assert values["body_position_error"] == pytest.approx(0.05 / np.sqrt(2))
    assert values["body_orientation_error"] == pytest.approx(0.2 / np.sqrt(2))
    assert values["body_position"] == pytest.approx(np.exp(-(0.05**2) / 2 / 0.1**2))
    assert values["strayed"] == 0.0
    far = replace(step, body_position=position + np.array([[0.0, 0.0, 0.0], [0.0, 0.31, 0.0]]))
    assert METRICS["strayed"].values(context, far) == 1.0
    assert describe_failure(context, far) == "strayed: right_hand is 0.31 m from the motion"
    assert METRICS["strayed"].values(context, replace(step, body_position=np.full((2, 3), np.nan))) == 1.0


def test_joints_and_anchor_of_a_motion():
    joints = tuple(msgspec.structs.replace(joint, name=name) for joint, name in zip(ROBOT.joints, "ab", strict=False))
    robot = msgspec.structs.replace(ROBOT, joints=joints)
    contract = contract_of(("a", "b"), task_type="tracking", anchor_body="base", command_names=("motion",))
    terms = {
        "reference_joint_pos": np.array([[0.0, 0.0], [0.1, 0.2]]),
        "anchor_pos": np.array([[0.0, 0.0, 0.8], [1.0, 0.0, 0.8]]),
        "anchor_quat": np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)),
    }
    context = StepContext(robot, contract, MotionReference(2, terms))
    pose = np.array([1.0, 0.3, 0.4, *about(0.6, (0.0, 0.0, 1.0))])
    step = sample(2, extern={ANCHOR_POSE: Extern(pose, 0.0)}, position=np.array([0.1, 0.5]))
    expected = {
        "joint_error": 0.3 / np.sqrt(2),
        "anchor_position": np.exp(-(0.5**2) / 0.3**2),
        "anchor_orientation": np.exp(-(0.6**2) / 0.4**2),
        "strayed": 1.0,  # 0.4 m too low
    }
    assert {name: METRICS[name].values(context, step) for name in expected} == pytest.approx(expected, rel=1e-6)
    assert describe_failure(context, step) == "strayed: 0.40 m off the motion's height, tilted by 0° against it"
    roll, yaw = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    poses = [  # height and rotation against the motion, and whether it has strayed: not by heading or place
        (0.34, about(3.0, yaw), False),
        (-0.36, about(0.0, yaw), True),
        (0.0, about(1.19, roll), False),
        (0.0, about(1.21, roll), True),
        (np.nan, about(0.0, yaw), True),
    ]
    for height, turn, expected in poses:
        pose = np.array([5.0, 5.0, 0.8 + height, *turn])
        step = sample(2, extern={ANCHOR_POSE: Extern(pose, 0.0)})
        assert METRICS["strayed"].values(context, step) == float(expected), height


def test_keys_of_a_song():
    robot = load_robot("lite_piano")
    contract = contract_of(robot.joint_names, task_type="piano", lookahead_steps=(0,), command_names=())
    song, pressed = np.zeros((2, 88)), np.zeros(88)
    song[1, [40, 44]] = pressed[[40, 50]] = 1.0
    context = StepContext(robot, contract, MotionReference(2, {"target_keys": song}))
    step = sample(14, extern={KEY_PRESSED: Extern(pressed, 0.0)})
    found = [float(METRICS[name].values(context, step)) for name in ("no_wrong_key", "precision", "recall", "f1")]
    assert found == [0.0, 0.5, 0.5, 0.5]


def test_feet_are_found_and_slide():
    feet = Feet(ROBOT)
    assert feet.bodies == ("left_foot", "right_foot")
    before = feet.place(np.zeros((1, 2, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (1, 2, 1)))
    before[..., 2] = 0.0
    moved = before + np.array([0.6, 0.8, 0.0]) * 0.5 * 0.02
    assert feet.slip(before, moved, 0.02) == pytest.approx([0.5])
    assert np.isnan(feet.slip(before + np.array([0.0, 0.0, 0.02]), moved, 0.02)).all(), "in the air it does not slide"
