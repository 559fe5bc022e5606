from __future__ import annotations

import os
from pathlib import Path

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.input_files import is_file, regular_file


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
