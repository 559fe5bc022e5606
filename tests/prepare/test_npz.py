from pathlib import Path

import numpy as np
import pytest
from motion_samples import joint_path, write_npz

from humanoid_sim.errors import InputError
from humanoid_sim.prepare.npz import read_npz


def test_reading(tmp_path: Path) -> None:
    motion = read_npz(write_npz(tmp_path / "dance.npz"))
    assert (motion.fps, motion.frame_count, motion.joint_names, motion.body_names) == (50.0, 40, None, None)
    assert motion.joint_position is not None
    np.testing.assert_allclose(motion.joint_position, joint_path(), atol=1e-6)
    assert motion.body_position is not None
    assert motion.body_position.shape == (40, 18, 3)


def test_names_are_believed(tmp_path: Path) -> None:
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
def test_a_bad_file(tmp_path: Path, changes: dict[str, np.ndarray | None], reason: str) -> None:
    path = write_npz(tmp_path / "dance.npz", **changes)
    with pytest.raises(InputError) as caught:
        read_npz(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"fps: 50\n", b"PK\x03\x04 cut"])
def test_what_is_no_npz(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "dance.npz"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"is no whole \.npz file of plain arrays"):
        read_npz(path)


def test_a_single_array(tmp_path: Path) -> None:
    path = tmp_path / "dance.npz"
    with path.open("wb") as file:
        np.save(file, np.zeros(3))
    with pytest.raises(InputError, match="holds a single array"):
        read_npz(path)


def test_a_file_cut_short_is_never_read(tmp_path: Path) -> None:
    path = write_npz(tmp_path / "dance.npz")
    data = path.read_bytes()
    for length in range(0, len(data), 997):
        path.write_bytes(data[:length])
        with pytest.raises(InputError):
            read_npz(path)
