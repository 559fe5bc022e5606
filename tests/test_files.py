from __future__ import annotations

import os
from pathlib import Path

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.files import is_file, regular_file, whole_file


def refusal(path: str | Path) -> str:
    with pytest.raises(InputError) as caught:
        regular_file(path, "a motion file (.mcap)")
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_file_and_a_link_to_it_are_taken(tmp_path: Path) -> None:
    file, link = tmp_path / "file", tmp_path / "link"
    file.touch()
    link.symlink_to(file)
    assert regular_file(str(file), "a file") == file
    assert regular_file(link, "a file") == link
    assert is_file(link)


def test_what_is_no_file_is_named(tmp_path: Path) -> None:
    pipe, loop = tmp_path / "pipe", tmp_path / "loop"
    os.mkfifo(pipe)
    loop.symlink_to(loop)
    gone, long = tmp_path / "gone", "x" * 5000
    assert refusal(gone) == f"{gone}: no such file, expected a motion file (.mcap)"
    assert refusal(tmp_path) == f"{tmp_path}: is a directory, expected a motion file (.mcap)"
    assert refusal(pipe) == f"{pipe}: is a pipe or a device, expected a motion file (.mcap)"
    assert refusal("/dev/zero") == "/dev/zero: is a pipe or a device, expected a motion file (.mcap)"
    assert refusal(loop) == f"{loop}: cannot be read: Too many levels of symbolic links"
    assert refusal(long) == f"{long}: cannot be read: File name too long"
    assert refusal("a\0b") == "a\0b: is no name of a file, expected a motion file (.mcap)"
    for path in (gone, tmp_path, pipe, loop, long, "a\0b"):
        assert not is_file(path)


def test_a_name_of_full_length_can_be_written(tmp_path: Path) -> None:
    path = tmp_path / ("é" * 127)  # 254 bytes of 255
    with whole_file(path) as file:
        file.write(b"whole")
    assert path.read_bytes() == b"whole"
    assert list(tmp_path.iterdir()) == [path]


def test_a_name_that_is_too_long_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot be written: File name too long$"), whole_file(tmp_path / ("x" * 300)):
        pass
    assert list(tmp_path.iterdir()) == []


def test_two_at_once_do_not_meet(tmp_path: Path) -> None:
    names = [f"{'x' * 100}{end}" for end in "ab"]
    with whole_file(tmp_path / names[0]) as first, whole_file(tmp_path / names[1]) as second:
        first.write(b"a")
        second.write(b"b")
    assert [(tmp_path / name).read_bytes() for name in names] == [b"a", b"b"]


def test_a_block_that_raises_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"before")
    with pytest.raises(TypeError), whole_file(path) as file:
        file.write("text")
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]
