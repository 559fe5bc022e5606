from __future__ import annotations

import os
from pathlib import Path

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.rendering.output import check_output, replacing


def test_a_good_path_is_returned_and_nothing_is_left(tmp_path: Path) -> None:
    assert check_output(str(tmp_path / "run.MP4"), "video", (".mp4",)) == tmp_path / "run.MP4"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("run.avi", r"video '.*run\.avi': suffix is '\.avi', accepted: \.mp4"),
        ("run", r"suffix is '', accepted: \.mp4"),
        ("missing/run.mp4", r"there is no folder '.*missing'"),
        ("folder.mp4", r"is a folder, expected the name of a file"),
    ],
)
def test_a_bad_path_is_refused(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "folder.mp4").mkdir()
    with pytest.raises(InputError, match=message):
        check_output(tmp_path / name, "video", (".mp4",))


def test_a_folder_that_takes_no_files_is_refused(tmp_path: Path) -> None:
    target = Path("/proc/self") if os.geteuid() == 0 else tmp_path
    if os.geteuid() != 0:
        tmp_path.chmod(0o500)
    with pytest.raises(InputError, match=r"cannot write to folder '.*': \w+"):
        check_output(target / "run.mp4", "video", (".mp4",))


def test_a_file_is_replaced_at_the_end_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "run.mp4"
    path.write_text("old")

    def write_half() -> None:
        with replacing(path) as temporary:
            temporary.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_half()
    assert [(entry.name, entry.read_text()) for entry in tmp_path.iterdir()] == [("run.mp4", "old")]
    with replacing(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"
    assert [(entry.name, entry.read_text()) for entry in tmp_path.iterdir()] == [("run.mp4", "new")]
