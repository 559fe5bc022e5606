from __future__ import annotations

from pathlib import Path

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.recording.whole_file import whole_file


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
