from pathlib import Path

import pytest

from humanoid_sim.assets import ASSETS, motion_path, policy_path
from humanoid_sim.errors import InputError


def test_sample_motions_go_by_name_and_files_by_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert motion_path("wave").name == "wave.mcap"
    (tmp_path / "mine.mcap").touch()
    assert motion_path("mine.mcap") == Path("mine.mcap")
    with pytest.raises(InputError, match="unknown motion 'mine'; known: circle, "):
        motion_path("mine")


def test_sample_policies_go_by_name_and_files_by_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert policy_path("lite_piano") == ASSETS / "policies" / "lite_piano.onnx"
    assert policy_path("missing.onnx") == Path("missing.onnx")  # whoever opens it says so
    assert policy_path("runs/lite_piano") == Path("runs/lite_piano")
    with pytest.raises(InputError, match=r"^--baseline: unknown policy 'xyz'; known: .*, other; or a file that exists"):
        policy_path("xyz", "--baseline", also=("other",))
    (tmp_path / "lite_tracking").mkdir()
    assert policy_path("lite_tracking").name == "lite_tracking.onnx"
    (tmp_path / "lite_piano").touch()
    assert policy_path("lite_piano") == Path("lite_piano")
