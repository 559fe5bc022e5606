"""Files of a user: what cannot be read or written is one line, and outputs exist whole or not at all."""

import os

import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.files import output_file, read_arrays, regular_file, whole_file


def test_what_is_no_file_is_named_and_not_opened(tmp_path):
    pipe, loop = tmp_path / "pipe", tmp_path / "loop"
    os.mkfifo(pipe)
    loop.symlink_to(loop)
    cases = {
        tmp_path / "gone": "no such file, expected a motion file",
        tmp_path: "is a directory, expected a motion file",
        pipe: "is a pipe or a device",
        "/dev/zero": "is a pipe or a device",
        loop: "cannot be read: ",
        "x" * 5000: "cannot be read: ",
        "a\0b": "cannot be read: ",
    }
    for path, reason in cases.items():
        with pytest.raises(InputError) as caught:
            regular_file(path, "a motion file (.mcap)")
        assert str(caught.value).startswith(f"{path}: {reason}")
        assert "\n" not in str(caught.value)
    (tmp_path / "large").write_bytes(bytes(9))
    with pytest.raises(InputError, match="has 9 bytes, expected a motion of at most 8"):
        regular_file(tmp_path / "large", "a motion", 8)


def test_a_block_that_raises_leaves_the_old_file(tmp_path):
    path = tmp_path / "file"
    with whole_file(path) as file:
        file.write(b"before")
        assert not path.exists()
    with pytest.raises(TypeError), whole_file(path) as file:
        file.write("text")
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(InputError, match="file/below: cannot be written"), whole_file(path / "below"):
        pass


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("run.avi", r"expected a name that ends in \.mp4 or \.mov"),
        ("missing/run.mp4", "the folder '.*missing' does not exist"),
        ("folder.mp4", "is a directory"),
        ("pipe.mp4", "is a pipe or a device"),
        ("there.mp4", "exists; choose another name, or add --overwrite"),
        (f"{'x' * 300}.mp4", "cannot be written"),
    ],
)
def test_a_bad_output_is_refused(tmp_path, name, message):
    (tmp_path / "folder.mp4").mkdir()
    os.mkfifo(tmp_path / "pipe.mp4")
    (tmp_path / "there.mp4").touch()
    with pytest.raises(InputError, match=f"^--video: .*{message}"):
        output_file(tmp_path / name, "--video", ".mp4", ".mov", overwrite=False)
    assert output_file(tmp_path / "there.mp4", "--video") == tmp_path / "there.mp4"


def refusal(path):
    with pytest.raises(InputError) as caught:
        read_arrays(path)
    return str(caught.value).removeprefix(f"{path}: ")


def test_arrays_that_need_code_are_refused(tmp_path):
    np.savez(tmp_path / "a.npz", x=np.array([{}], dtype=object))
    assert refusal(tmp_path / "a.npz").startswith("is not a complete .npz file of plain arrays: Object arrays")


def test_an_archive_that_was_cut_is_one_line(tmp_path):
    np.savez(tmp_path / "a.npz", x=np.zeros(100))
    (tmp_path / "a.npz").write_bytes((tmp_path / "a.npz").read_bytes()[:300])
    assert refusal(tmp_path / "a.npz").startswith("is not a complete .npz file of plain arrays: ")
