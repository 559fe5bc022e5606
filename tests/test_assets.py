from __future__ import annotations

from pathlib import Path

import pytest

from humanoid_sim.assets import motion_path
from humanoid_sim.errors import InputError


def test_sample_motions_go_by_name_and_files_by_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert motion_path("wave").name == "wave.mcap"
    (tmp_path / "mine.mcap").touch()
    assert motion_path("mine.mcap") == Path("mine.mcap")
    with pytest.raises(InputError, match="'mine' is neither a file nor a sample motion; samples: circle, "):
        motion_path("mine")
