from __future__ import annotations

import re
from pathlib import Path

import pytest

from humanoid_sim.assets import motion_path, song_path
from humanoid_sim.errors import InputError


def test_sample_motions_go_by_name_and_files_by_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert motion_path("wave").name == "wave.mcap"
    (tmp_path / "mine.mcap").touch()
    assert motion_path("mine.mcap") == Path("mine.mcap")
    with pytest.raises(InputError, match="unknown motion 'mine'; known: circle, "):
        motion_path("mine")


def test_sample_songs_go_by_name_and_a_near_miss_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert song_path("twinkle").name == "twinkle.mid"
    (tmp_path / "mine.mid").touch()
    assert song_path("mine.mid") == Path("mine.mid")
    message = "unknown song 'ode-to-joy' (did you mean 'ode_to_joy'?); known: black_keys, con"
    with pytest.raises(InputError, match=re.escape(f"--song: {message}")):
        song_path("ode-to-joy")
    with pytest.raises(InputError, match="--song: unknown song 'xyz'; known: black_keys"):
        song_path("xyz")
