import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from motion_samples import joint_path, write_npz

from humanoid_sim.errors import InputError
from humanoid_sim.prepare.motion_files import read_csv, read_npz

JOINTS = ("hip", "knee")
ROW = "0.1,0.2,0.8,0,0,0,1,0.3,0.4\n"


def read(path, text, fps=30.0, *, floating=True):
    path.write_text(text, encoding="utf-8")
    return read_csv(path, JOINTS, fps, floating=floating, quaternions=None)


def test_numbers_alone(tmp_path):
    motion = read(tmp_path / "a.csv", ROW * 3)
    assert (motion.fps, motion.frame_count, motion.joint_names, motion.quaternion_order) == (30.0, 3, None, "xyzw")
    assert motion.joint_position[0].tolist() == [0.3, 0.4]
    assert motion.base_position[0].tolist() == [0.1, 0.2, 0.8]


def test_joints_alone_of_a_robot_with_a_fixed_base(tmp_path):
    motion = read(tmp_path / "a.csv", "0.3,0.4\n\n0.5,0.6\n", floating=False)
    assert motion.base_position is None
    assert motion.joint_position.tolist() == [[0.3, 0.4], [0.5, 0.6]]


def test_column_names_in_any_order(tmp_path):
    text = "time,knee,hip_dof,root_qw,root_qx,root_qy,root_qz,base_x,y,base_pos_z\n"
    text += "".join(f"{t:.3f},0.4,0.3,1,0,0,0,0.1,0.2,0.8\n" for t in np.arange(4) / 30)
    motion = read(tmp_path / "a.csv", text, None)
    assert (motion.fps, motion.joint_names, motion.quaternion_order) == (30.0, ("hip", "knee"), "wxyz")
    assert motion.joint_position[0].tolist() == [0.3, 0.4]
    assert motion.base_quaternion[0].tolist() == [1.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("text", "fps", "reason"),
    [
        ("", 30.0, "is empty"),
        (ROW, None, "use --fps"),
        ("1,2,3\n", 30.0, "line 1 has 3 numbers, expected 9, base pose and 2 joints"),
        (ROW + "1,2\n", 30.0, "line 2 has 2 numbers, the lines before 9"),
        (ROW + ROW.replace("0.3", "x"), 30.0, "line 2, column 8: 'x' is not a number"),
        (ROW.replace("0.3", "nan"), 30.0, "joint_position is nan at frame 0"),
        (ROW.replace(",1,", ",3,"), 30.0, "base_quaternion at frame 0 has norm 3"),
        ("hip,ankle\n1,2\n", 30.0, "unknown column 'ankle'"),
        ("base_x,bas_y\n1,2\n", 30.0, "unknown column 'bas_y' (did you mean 'base_y'?); known: time, frame, base_x, "),
        ("hip,hip\n1,2\n", 30.0, "columns 'hip' and 'hip' mean the same"),
        ("hip\n1\n", 30.0, "has no column for knee"),
        ("hip,knee\n1,2\n", 30.0, "needs all of the columns base_x"),
        ("hip,knee\n", 30.0, "line 1 is not a frame of numbers, and none follows it"),
        ("hip,knee\n1,2,3\n", 30.0, "has 2 column names and 3 numbers per line"),
    ],
)
def test_a_bad_csv(tmp_path, text, fps, reason):
    with pytest.raises(InputError) as caught:
        read(tmp_path / "a.csv", text, fps)
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("times", "fps", "reason"),
    [
        ("0,1,1", None, "does not increase"),
        ("0,1,2,4", None, "not evenly spaced in time: 2 s after frame 2"),
        ("0,0.02,0.04", 30.0, "--fps is 30, and its column 'time' says 50"),
    ],
)
def test_bad_times(tmp_path, times, fps, reason):
    text = "time,hip,knee\n" + "".join(f"{time},0,0\n" for time in times.split(","))
    with pytest.raises(InputError) as caught:
        read(tmp_path / "a.csv", text, fps, floating=False)
    assert reason in str(caught.value)


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("csv") / "a.csv"
    path.write_bytes(data)
    try:
        motion = read_csv(path, JOINTS, 30.0, floating=False, quaternions=None)
    except InputError:
        return
    assert motion.frame_count >= 1


def test_reading(tmp_path):
    motion = read_npz(write_npz(tmp_path / "dance.npz"))
    assert (motion.fps, motion.frame_count, motion.joint_names, motion.body_names) == (50.0, 40, None, ())
    assert motion.joint_position is not None
    np.testing.assert_allclose(motion.joint_position, joint_path(), atol=1e-6)
    assert motion.body_position.shape == (40, 18, 3)


def test_names_are_believed(tmp_path):
    names = np.array([f"joint {i}" for i in range(14)])
    motion = read_npz(write_npz(tmp_path / "dance.npz", joint_names=names))
    assert motion.joint_names == tuple(names)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"joint_vel": None, "fps": None}, "has no fps, joint_vel; it holds body_ang_vel_w"),
        ({"joint_pos": np.zeros(40)}, "joint_pos has shape (40,), expected (F, n)"),
        ({"body_quat_w": np.zeros((40, 18, 3))}, "body_quat_w has shape (40, 18, 3), expected (F, B, 4)"),
        ({"fps": np.array([50, 30])}, "fps has shape (2,), expected one number"),
        ({"joint_pos": np.array([["a"] * 14] * 40)}, "joint_pos has type <U1, expected numbers"),
        ({"joint_pos": np.zeros((39, 14))}, "joint_velocity has 40 frames, joint_position has 39"),
        ({"joint_names": np.arange(14)}, "joint_names is int64 of shape (14,), expected a list of texts"),
        ({"joint_pos": np.array([[{}] * 14] * 40)}, "Object arrays cannot be loaded"),
    ],
)
def test_a_bad_npz(tmp_path, changes, reason):
    path = write_npz(tmp_path / "dance.npz", **changes)
    with pytest.raises(InputError) as caught:
        read_npz(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"fps: 50\n", b"PK\x03\x04 cut"])
def test_what_is_no_npz(tmp_path, content):
    path = tmp_path / "dance.npz"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"is not a complete \.npz file of plain arrays"):
        read_npz(path)


def test_a_single_array(tmp_path):
    path = tmp_path / "dance.npz"
    with path.open("wb") as file:
        np.save(file, np.zeros(3))
    with pytest.raises(InputError, match="holds a single array"):
        read_npz(path)


def test_a_file_cut_short_is_never_read(tmp_path):
    path = write_npz(tmp_path / "dance.npz")
    data = path.read_bytes()
    for length in range(0, len(data), 997):
        path.write_bytes(data[:length])
        with pytest.raises(InputError):
            read_npz(path)
