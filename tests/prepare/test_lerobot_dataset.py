import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.prepare.lerobot_dataset import episode_motion, parse_roles

JOINTS = ("hip", "knee")
STATE = np.arange(12.0).reshape(3, 4)
POSITION = np.arange(18.0).reshape(3, 6)
TIMES = np.arange(3) / 50.0


def read(columns, names=None, **roles):
    return episode_motion("dances episode 0", columns, names or {}, 50.0, roles, JOINTS)


def test_joints_by_the_names_of_the_state():
    names = {"observation.state": {"motors": ["knee.vel", "knee.pos", "gripper.pos", "hip.pos"]}}
    motion = read({"observation.state": STATE, "timestamp": TIMES}, names)
    assert motion.joint_names == ("knee", "hip")
    assert motion.joint_position.tolist() == STATE[:, [1, 3]].tolist()


def test_joints_without_names():
    motion = read(
        {"observation.joint_pos": STATE[:, :2], "joint_vel": STATE[:, 2:]}, {"observation.joint_pos": ["0", "1"]}
    )
    assert motion.joint_names is None
    assert motion.joint_velocity.tolist() == STATE[:, 2:].tolist()


def test_a_feature_by_its_role():
    motion = read({"measured": STATE[:, :2], "observation.state": STATE}, joint_pos="measured")
    assert motion.joint_position.shape == (3, 2)


@pytest.mark.parametrize("flat", [True, False])
def test_bodies_in_the_base_frame(flat):
    rows = np.tile([1.0, 0.0, 0.0, 1.0, 0.0, 0.0], (3, 2))
    position = POSITION if flat else POSITION.reshape(3, 2, 3)
    names = {"motion_body_pos_b": [f"{body}.{axis}" for body in ("left_hand", "right_hand") for axis in "xyz"]}
    motion = read({"motion_body_pos_b": position, "motion_body_ori_b": rows}, names)
    assert (motion.frame, motion.body_names) == ("base", ("left_hand", "right_hand"))
    assert motion.body_position.shape == (3, 2, 3)
    np.testing.assert_allclose(motion.body_quaternion, np.tile([1.0, 0.0, 0.0, 0.0], (3, 2, 1)), atol=1e-12)


def test_bodies_in_the_world():
    quaternion = np.tile([1.0, 0.0, 0.0, 0.0], (3, 2))
    motion = read({"joint_pos": STATE[:, :2], "body_pos_w": POSITION, "body_quat_w": quaternion})
    assert (motion.frame, motion.body_names) == ("world", ())
    assert motion.body_quaternion.shape == (3, 2, 4)


def test_the_reference_comes_before_what_the_robot_did():
    rows = np.tile([1.0, 0.0, 0.0, 1.0, 0.0, 0.0], (3, 2))
    columns = {"reference.motion_body_pos_b": POSITION, "reference.motion_body_ori_b": rows, "observation.state": STATE}
    motion = read(columns, {"observation.state": ["hip.pos", "knee.pos", "a", "b"]})
    assert motion.joint_position is None
    assert motion.body_position is not None


@pytest.mark.parametrize(
    ("columns", "names", "reason"),
    [
        ({"image": STATE}, {}, "has no feature with joint positions or body poses; it has image"),
        (
            {"observation.state": STATE},
            {"observation.state": ["hip.pos", "a", "b", "c"]},
            "'observation.state' has no knee",
        ),
        ({"body_pos_b": STATE}, {}, r"'body_pos_b' has shape \(4,\) per frame, expected 3 values per body"),
        (
            {"joint_pos": STATE, "timestamp": [0.0, 0.02, 0.06]},
            {},
            r"timestamp rises by 0\.04 s after frame 1, but fps is 50",
        ),
    ],
)
def test_columns_that_are_no_motion(columns, names, reason):
    with pytest.raises(InputError, match=reason):
        read({key: np.asarray(value) for key, value in columns.items()}, names)


def test_roles():
    assert parse_roles(["joint_pos=a.b"]) == {"joint_pos": "a.b"}
    with pytest.raises(InputError, match="expected ROLE=FEATURE with a role of joint_pos"):
        parse_roles(["pos=a"])
    with pytest.raises(InputError, match="--features: dances episode 0 has no feature 'a'"):
        read({"joint_pos": STATE}, joint_pos="a")
