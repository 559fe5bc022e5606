"""Files of a user: what cannot be read or written is one line, and outputs exist whole or not at all."""

import json
import os

import msgspec
import numpy as np
import pytest

from humanoid_sim.errors import InputError, meant
from humanoid_sim.files import json_text, output_file, read_arrays, regular_file, whole_file
from humanoid_sim.strict_yaml import converted, read_yaml


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("gone", "no such file"),
        ("a\0b", "no such file"),
        ("folder", "is a directory"),
        ("pipe", "is not a regular file"),
        ("x" * 5000, "cannot be read"),
    ],
)
def test_what_is_no_file_is_named_and_not_opened(tmp_path, name, reason):
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match=reason):
        regular_file(tmp_path / name, "a motion file (.mcap)")


@pytest.mark.parametrize(
    ("start", "kind"),
    [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:4d", "a pointer of Git LFS, `git lfs pull`"),
        (b"<!DOCTYPE html><html>Sign in", "a web page"),
        (b"SQLite format 3\0", "a SQLite database, .*`ros2 bag convert`"),
    ],
)
def test_what_stands_in_a_files_place_after_a_download_is_named(tmp_path, start, kind):
    (tmp_path / "policy.onnx").write_bytes(start)
    with pytest.raises(InputError, match=f"policy.onnx: is {kind}.*; expected an ONNX file"):
        regular_file(tmp_path / "policy.onnx", "an ONNX file")


def test_a_file_of_any_size_is_read_only_where_no_more_memory_is_needed(tmp_path):
    (tmp_path / "large").write_bytes(bytes(9))
    with pytest.raises(InputError, match="has 9 bytes, expected a motion of at most 8"):
        regular_file(tmp_path / "large", "a motion", 8)
    assert regular_file(tmp_path / "large", "a motion", None) == tmp_path / "large"


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
        ("there.mp4", "exists; choose another name, or add --overwrite"),
        (f"{'x' * 300}.mp4", "cannot be written"),
    ],
)
def test_a_bad_output_is_refused(tmp_path, name, message):
    (tmp_path / "folder.mp4").mkdir()
    (tmp_path / "there.mp4").touch()
    with pytest.raises(InputError, match=f"^--video: .*{message}"):
        output_file(tmp_path / name, "--video", ".mp4", ".mov", overwrite=False)
    assert output_file(tmp_path / "there.mp4", "--video") == tmp_path / "there.mp4"


def test_arrays_that_need_code_or_were_cut_are_one_line(tmp_path):
    np.savez(tmp_path / "code.npz", x=np.array([{}], dtype=object))
    np.savez(tmp_path / "cut.npz", x=np.zeros(100))
    (tmp_path / "cut.npz").write_bytes((tmp_path / "cut.npz").read_bytes()[:300])
    (tmp_path / "table.npz").write_text("0.1,0.2")
    for name in ("code.npz", "cut.npz", "table.npz"):
        with pytest.raises(InputError, match=f"{name}: is not a complete .npz file(?!.*If you trust)"):
            read_arrays(tmp_path / name)


def test_json_has_null_for_what_is_no_number():
    assert json.loads(json_text({"a": [np.float64("nan"), -np.inf, 1e-5]})) == {"a": [None, None, 1e-5]}


@pytest.mark.parametrize(
    ("name", "known", "expected"),
    [
        ("LEFT_HIP_PITCH_JOINT", ("left_hip_pitch_joint",), "left_hip_pitch_joint"),
        ("left_shoulder_pitch", ("left_ankle_pitch", "left_hip_pitch"), ""),
        ("left_knee", ("right_knee",), ""),
        ("g1/left_knee", ("left_knee", "right_knee"), "left_knee"),
        ("left_knee", ("g1_left_knee", "g1_right_knee"), "g1_left_knee"),
        ("knee", ("left_knee", "right_knee"), ""),
    ],
)
def test_a_near_name_is_one_that_can_be_meant(name, known, expected):
    assert meant(name, known) == (f" (did you mean '{expected}'?)" if expected else "")


class Wheel(msgspec.Struct):
    radius: float


class Cart(msgspec.Struct):
    wheels: list[Wheel]


@pytest.mark.parametrize(
    ("document", "problem"),
    [
        ({"wheels": [{"radius": 1}, {"radius": "x"}]}, "wheels[1].radius: is 'x', expected `float`"),
        ({}, "Object missing required field `wheels`"),
    ],
)
def test_the_field_comes_first(document, problem):
    with pytest.raises(InputError) as caught:
        converted(document, Cart, "cart.yaml")
    assert str(caught.value) == f"cart.yaml: {problem}"


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        (b"a: [", "line "),
        (b"a: 1\na: 2", "line 2, column 1: not valid YAML: 'a' is given twice"),
        (b"\xff", "not YAML that can be read: "),
    ],
)
def test_a_file_that_cannot_be_read_is_one_line_with_its_place(tmp_path, data, problem):
    (tmp_path / "x.yaml").write_bytes(data)
    with pytest.raises(InputError) as caught:
        read_yaml(tmp_path / "x.yaml")
    assert str(caught.value).startswith(f"{tmp_path}/x.yaml: {problem}")
