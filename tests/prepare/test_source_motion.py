import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.prepare.source_motion import SourceMotion, swap_quaternion_order

UNIT = np.tile([1.0, 0.0, 0.0, 0.0], (4, 2, 1))


def motion(**changes):
    fields = {
        "source": "dance.npz",
        "kind": "npz",
        "fps": 50.0,
        "joint_position": np.zeros((4, 3)),
        "body_position": np.zeros((4, 2, 3)),
        "body_quaternion": UNIT,
    }
    return SourceMotion(**fields | changes)


def test_a_good_one():
    good = motion(fps=25)
    assert good.frame_count == 4
    assert set(good.arrays()) == {"joint_position", "body_position", "body_quaternion"}
    assert good.select(np.array([0, 3])).frame_count == 2


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"fps": 0.0}, "fps is 0"),
        ({"fps": np.nan}, "fps is nan"),
        ({"joint_position": np.zeros((0, 3))}, "joint_position has no frames"),
        ({"body_position": np.zeros((3, 2, 3))}, "body_position has 3 frames, joint_position has 4"),
        (
            {"joint_position": np.where(np.arange(12).reshape(4, 3) == 7, np.nan, 0)},
            "joint_position is nan at frame 2, index 1",
        ),
        ({"joint_velocity": np.zeros((4, 2))}, "3 joint positions and 2 joint velocities"),
        ({"body_quaternion": UNIT[:, :1]}, "2 body positions and 1 body orientations"),
        ({"body_quaternion": 0.5 * UNIT}, "body_quaternion at frame 0, body 0 has norm 0.5"),
        ({"joint_names": ("a", "b")}, "joint_names has 2 names for 3 columns"),
        ({"joint_names": ("a", "b", "a")}, "joint_names has 'a' twice"),
        ({"joint_position": None, "body_position": None, "body_quaternion": None}, "holds neither"),
    ],
)
def test_a_motion_that_contradicts_itself(changes, reason):
    with pytest.raises(InputError) as caught:
        motion(**changes)
    assert str(caught.value).startswith("dance.npz: ")
    assert reason in str(caught.value)


def test_quaternions_are_made_unit():
    np.testing.assert_allclose(motion(body_quaternion=1.01 * UNIT).body_quaternion, UNIT)


def test_quaternion_orders():
    assert swap_quaternion_order(np.array([1.0, 2.0, 3.0, 4.0]), "xyzw").tolist() == [4.0, 1.0, 2.0, 3.0]
    assert swap_quaternion_order(np.array([1.0, 2.0, 3.0, 4.0]), "wxyz").tolist() == [1.0, 2.0, 3.0, 4.0]
