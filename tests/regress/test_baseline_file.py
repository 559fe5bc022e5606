"""Baselines and results on disk."""

from __future__ import annotations

from pathlib import Path

import pytest
from regress_runs import episode, run

from humanoid_sim.errors import InputError
from humanoid_sim.regress.baseline_file import read_baseline, write_json


def test_round_trip(tmp_path: Path) -> None:
    written = run([episode("a", 0, {"joint_error": 0.1, "effort": None}), episode("a", 1, {}, "fell")])
    write_json(tmp_path / "base.json", written)
    assert read_baseline(tmp_path / "base.json") == written
    assert b'"joint_error": 0.1' in (tmp_path / "base.json").read_bytes()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is no baseline of `regress --write-baseline`"),
        ("[1]", r"is no baseline.*Expected `object`, got `array`"),
        ('{"name": 1}', r"is no baseline.*Expected `str`, got `int` - at `\$.name`"),
        ('{"format": "humanoid_sim.regress/9"}', "is no baseline.*humanoid_sim.regress/9"),
    ],
)
def test_what_is_no_baseline(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "base.json"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as error:
        read_baseline(path)
    assert str(error.value).startswith(f"{path}: ")


def test_a_baseline_without_episodes(tmp_path: Path) -> None:
    write_json(tmp_path / "base.json", run([]))
    with pytest.raises(InputError, match="holds no episodes"):
        read_baseline(tmp_path / "base.json")


def test_a_result_taken_for_a_baseline(tmp_path: Path) -> None:
    path = tmp_path / "out.json"
    path.write_text('{"suite": {}, "candidates": []}')
    with pytest.raises(InputError, match="is a result of --json, expected a baseline of --write-baseline"):
        read_baseline(path)


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no such file, expected a baseline \(.json\) or a checkpoint \(.onnx\)"):
        read_baseline(tmp_path / "base.json")
