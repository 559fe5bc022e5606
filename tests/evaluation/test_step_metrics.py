"""Rows of the table by hand: for one robot, and for a batch the same."""

from dataclasses import fields, replace

import numpy as np
import pytest
from models import contract_of

from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.controllers.rotation import multiply, rotation_6d
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.errors import pose_error, quaternion_angle
from humanoid_sim.evaluation.feet import Feet, find_feet
from humanoid_sim.evaluation.step import StepContext, StepSample
from humanoid_sim.evaluation.step_metrics import METRICS, describe_failure
from humanoid_sim.mit import ANCHOR_POSE, KEY_PRESSED, Extern, MITState
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.floating_base import BaseState


def about(angle, axis):
    return np.array([np.cos(angle / 2), *(np.sin(angle / 2) * np.array(axis))])


def sample(n, **changes):
    return StepSample(
        state=replace(MITState.unknown(n), joint_position=np.zeros(n)),
        action=np.full(n, 0.5, np.float32),
        previous_action=np.full(n, 0.25, np.float32),
        torque=np.full(n, 2.0),
        frame=1,
        step=1,
        body_position=np.zeros((0, 3)),
        body_quaternion=np.zeros((0, 4)),
        command=np.array([0.5, 0.0, 0.1]),
        **changes,
    )


def batch(one):
    """The same step of two robots."""

    def doubled(value):
        if isinstance(value, np.ndarray):
            return np.stack([value, value])
        if isinstance(value, MITState):
            arrays = {
                f.name: doubled(getattr(value, f.name)) for f in fields(value) if f.name not in ("time", "extern")
            }
            live = {name: replace(x, value=doubled(x.value)) for name, x in value.extern.items()}
            return replace(value, **arrays, extern=live)
        if isinstance(value, BaseState):
            return replace(value, **{f.name: doubled(getattr(value, f.name)) for f in fields(value) if f.name != "up"})
        return np.array([value, value]) if isinstance(value, int) else value

    return replace(one, **{f.name: doubled(getattr(one, f.name)) for f in fields(one) if f.init})


def value(context, step, name):
    """The row's value for one robot, which a batch has too."""
    context.require(name, METRICS[name].needs)
    found = METRICS[name].values(context, step)
    assert np.shape(found) == ()
    np.testing.assert_array_equal(METRICS[name].values(context, batch(step)), [found, found])
    return float(found)


def world_motion():
    """Two frames of two joints and an anchor, which moves 1 m forward."""
    terms = {
        "reference_joint_pos": np.array([[0.0, 0.0], [0.1, 0.2]]),
        "anchor_pos": np.array([[0.0, 0.0, 0.8], [1.0, 0.0, 0.8]]),
        "anchor_quat": np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)),
    }
    return MotionReference(2, terms)


ROBOT = load_robot("lite_biped")
NAMES = ROBOT.joint_names
WALKER = contract_of(NAMES, default_joint_pos=ROBOT.initial_position)
BASE = BaseState(
    position=np.array([0.0, 0.0, 0.7]),
    quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
    linear_velocity=np.array([0.4, 0.0, 0.2]),
    angular_velocity=np.array([0.1, 0.2, 0.3]),
    centre_of_mass=np.array([0.0, 0.0, 0.6]),
    floor=np.array(0.0),
)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("velocity_error", 0.1),
        ("yaw_rate_error", 0.2),
        ("linear_velocity", np.exp(-(0.1**2) / 0.25**2)),
        ("yaw_rate", np.exp(-(0.2**2) / 0.5**2)),
        ("vertical_velocity", 0.04),
        ("rocking", 0.05),
        ("lean", 0.0),
        ("tilt", 0.0),
        ("fallen", 0.0),
        ("alive", 1.0),
        ("effort", 2.0),
        ("action_change", 14 * 0.0625),
        ("power", 0.0),
    ],
)
def test_a_walking_robot(name, expected):
    context = StepContext(ROBOT, WALKER, MotionReference(1, {}), standing_height=0.6)
    assert value(context, sample(len(NAMES), base=BASE), name) == pytest.approx(expected, abs=1e-12)


def test_a_robot_that_lies_has_fallen():
    lying = replace(BASE, centre_of_mass=np.array([0.0, 0.0, 0.3]))
    context = StepContext(ROBOT, WALKER, MotionReference(1, {}), standing_height=0.6)
    step = sample(len(NAMES), base=lying)
    assert value(context, step, "fallen") == 1.0
    assert describe_failure(context, step) == "fell: its centre of mass sank to 0.30 m, it stood at 0.60 m"


def test_joints_at_their_stops_and_at_their_effort_limit():
    context = StepContext(ROBOT, WALKER, MotionReference(1, {}))
    q = 0.5 * (context.lower + context.upper)
    q[0], q[1] = context.lower[0] + 0.02, context.upper[1] + 0.01
    step = replace(sample(len(NAMES)), state=replace(MITState.unknown(len(NAMES)), joint_position=q))
    assert value(context, step, "joint_stops") == pytest.approx(0.03 + 0.06)
    limited = replace(step, torque=0.9 * np.array(ROBOT.effort_limit))
    assert value(context, limited, "effort_share") == pytest.approx(len(NAMES) * 0.81)


def test_bodies_of_a_motion():
    robot = load_robot("lite")
    contract = contract_of(
        robot.joint_names, task_type="tracking", body_names=("left_hand", "right_hand"), command_names=("motion",)
    )
    target = np.tile(rotation_6d(np.eye(3)), (2, 2))
    reference = MotionReference(2, {"motion_body_pos_b": np.zeros((2, 6)), "motion_body_ori_b": target})
    context = StepContext(robot, contract, reference)
    position = np.array([[0.03, 0.0, 0.04], [0.0, 0.0, 0.0]])
    quaternion = np.stack([about(0.2, (0.0, 0.0, 1.0)), -about(0.0, (0.0, 0.0, 1.0))])
    step = replace(sample(14), body_position=position, body_quaternion=quaternion)
    assert context.tracked == ("left_hand", "right_hand")
    assert value(context, step, "body_position_error") == pytest.approx(0.05 / np.sqrt(2))
    assert value(context, step, "body_orientation_error") == pytest.approx(0.2 / np.sqrt(2))
    assert value(context, step, "body_position") == pytest.approx(np.exp(-(0.05**2) / 2 / 0.1**2))
    assert value(context, step, "strayed") == 0.0
    far = replace(step, body_position=position + np.array([[0.0, 0.0, 0.0], [0.0, 0.31, 0.0]]))
    assert value(context, far, "strayed") == 1.0
    assert describe_failure(context, far) == "strayed: right_hand is 0.31 m from the motion"


def test_joints_and_anchor_of_a_motion():
    contract = contract_of(("a", "b"), task_type="tracking", anchor_body="base", command_names=("motion",))
    two = replace_names(ROBOT, ("a", "b"))
    context = StepContext(two, contract, world_motion())
    pose = np.array([1.0, 0.3, 0.4, *about(0.6, (0.0, 0.0, 1.0))])
    state = replace(MITState.unknown(2), joint_position=np.array([0.1, 0.5]), extern={ANCHOR_POSE: Extern(pose, 0.0)})
    step = replace(sample(2), state=state)
    assert value(context, step, "joint_error") == pytest.approx(0.3 / np.sqrt(2), abs=1e-7)
    assert value(context, step, "anchor_position") == pytest.approx(np.exp(-(0.5**2) / 0.3**2), rel=1e-6)
    assert value(context, step, "anchor_orientation") == pytest.approx(np.exp(-(0.6**2) / 0.4**2), rel=1e-6)
    assert value(context, step, "strayed") == 1.0  # 0.4 m too low
    assert describe_failure(context, step) == "strayed: 0.40 m off the motion's height"


def replace_names(robot, names):
    """The robot with fewer joints, which is enough for figures."""
    import msgspec  # noqa: PLC0415

    joints = tuple(msgspec.structs.replace(joint, name=name) for joint, name in zip(robot.joints, names, strict=False))
    return msgspec.structs.replace(robot, joints=joints)


def test_keys_of_a_song():
    robot = load_robot("lite_piano")
    contract = contract_of(robot.joint_names, task_type="piano", lookahead_steps=(0,), command_names=())
    song = np.zeros((2, 88))
    song[1, [40, 44]] = 1.0
    context = StepContext(robot, contract, MotionReference(2, {"target_keys": song}))
    pressed = np.zeros(88)
    pressed[[40, 50]] = 1.0
    state = replace(MITState.unknown(14), extern={KEY_PRESSED: Extern(pressed, 0.0)})
    step = replace(sample(14), state=state)
    assert value(context, step, "no_wrong_key") == 0.0
    assert [value(context, step, name) for name in ("precision", "recall", "f1")] == [0.5, 0.5, 0.5]


def test_a_metric_that_does_not_fit_is_refused():
    context = StepContext(load_robot("lite"), contract_of(load_robot("lite").joint_names), MotionReference(1, {}))
    for name, needs in (("velocity_error", "floating base"), ("f1", "song"), ("joint_error", "motion with joints")):
        with pytest.raises(InputError, match=f"{name}: needs a {needs}"):
            context.require(name, METRICS[name].needs)


def test_feet_are_found_and_slide():
    feet = find_feet(ROBOT)
    assert feet.bodies == ("left_foot", "right_foot")
    assert feet.foot.count(0) == feet.foot.count(1) > 0
    sole = Feet(("foot",), (0,), np.zeros((1, 3)), 0.0)
    before = np.zeros((1, 1, 3))
    moved = before + np.array([0.6, 0.8, 0.0]) * 0.5 * 0.02
    assert sole.slip(before, moved, 0.02) == pytest.approx([0.5])
    assert np.isnan(sole.slip(before + np.array([0.0, 0.0, 0.02]), moved, 0.02)).all(), "in the air it does not slide"


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.0, np.pi])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_angle_between_quaternions_is_exact_from_tiny_to_half_a_turn(angle, sign):
    start = about(0.7, (0.0, 0.6, 0.8))
    other = sign * multiply(start, about(angle, (0.6, 0.0, 0.8)))
    assert quaternion_angle(start, other) == pytest.approx(angle, rel=1e-6, abs=1e-15)


def test_a_pose_error_is_offset_angle_and_tilt():
    pose = np.array([1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0])
    heading, leaning = about(1.0, (0.0, 0.0, 1.0)), about(0.5, (1.0, 0.0, 0.0))
    error = pose_error(np.stack([pose, pose]), np.array([[1.0, 2.3, 3.4], pose[:3]]), np.stack([heading, leaning]))
    assert error.offset[0] == pytest.approx([0.0, 0.3, 0.4])
    assert error.distance == pytest.approx([0.5, 0.0])
    assert error.angle == pytest.approx([1.0, 0.5])
    assert error.tilt == pytest.approx([0.0, 0.5])
