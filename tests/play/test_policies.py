from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import models
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.play import policies
from humanoid_sim.play.config import PlayConfig
from humanoid_sim.play.policies import choose_policy
from humanoid_sim.policy.motion import Motion, write_motion
from humanoid_sim.robots.description import load_robot

LITE = load_robot("lite")


def test_by_default_the_sample_policy_follows_the_sample_motion() -> None:
    choice = choose_policy(PlayConfig(), LITE)
    assert Path(choice.checkpoint.source).name == "lite_tracking.onnx"
    assert choice.motion_file is not None
    assert choice.motion_file.name == "wave.mcap"
    assert choice.warning == ""
    contract = choice.checkpoint.contract
    assert contract.observation_names == ("motion_body_pos_b", "motion_body_ori_b", "joint_pos", "joint_vel", "actions")
    assert (contract.action_count, contract.policy_dt) == (14, 0.02)
    assert choice.loaded.layout.width == choice.checkpoint.observation_width


@pytest.mark.parametrize("motion", ["circle", "reach"])
def test_a_sample_motion_goes_by_its_name(motion: str) -> None:
    choice = choose_policy(PlayConfig(motion=motion), LITE)
    assert choice.motion_file is not None
    assert choice.motion_file.stem == motion


def test_the_wrapper_goes_around_the_policy_that_runs() -> None:
    choice = choose_policy(PlayConfig(policy="placeholder"), LITE, lambda policy: lambda o, f: policy(o, f) + 7.0)  # type: ignore[operator]
    assert np.asarray(choice.loaded.policy(np.zeros(42, dtype=np.float32), 0)).tolist() == [7.0] * 14


def test_a_policy_of_the_users_needs_a_motion_and_says_which_dataset_it_was_made_for(tmp_path: Path) -> None:
    contract = models.contract(
        task_type="tracking",
        body_names=("hand",),
        observation=("motion_body_pos_b", "joint_pos", "actions"),
        dataset_repo_id="somebody/moves",
    )
    path = models.saved(tmp_path / "p.onnx", models.linear_model(models.write_metadata(contract)))
    with pytest.raises(InputError, match=r"--motion: is missing; .* follows a motion; its default is the dataset"):
        choose_policy(PlayConfig(policy=str(path)), LITE)
    write_motion(tmp_path / "m.mcap", Motion(np.ones((3, 9)), ("hand",), 0.02))
    choice = choose_policy(PlayConfig(policy=str(path), motion=str(tmp_path / "m.mcap")), LITE)
    assert choice.loaded.reference.frame_count == 3


def test_without_onnxruntime_zeros_stand_in_and_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(policies, "has_onnxruntime", lambda: False)
    choice = choose_policy(PlayConfig(), LITE)
    assert choice.warning == (
        "PLACEHOLDER POLICY: onnxruntime cannot be imported, so lite_tracking.onnx does NOT run; "
        "the action is zero. To run it: pip install onnxruntime"
    )
    assert choice.motion is not None
    width = choice.loaded.layout.width
    assert np.asarray(choice.loaded.policy(np.ones(width, dtype=np.float32), 3)).tolist() == [0.0] * 14


def test_a_run_without_onnxruntime_goes_on_loudly(tmp_path: Path) -> None:
    blocked = tmp_path / "blocked"
    blocked.mkdir()
    (blocked / "onnxruntime.py").write_text("raise ImportError('no shared library')\n", encoding="utf-8")
    run = subprocess.run(
        [sys.executable, "-m", "humanoid_sim.play", "--viewer", "none", "--record", "none", "--motion", "reach"],
        env={**os.environ, "PYTHONPATH": str(blocked)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (run.returncode, run.stderr) == (0, "")
    assert "PLACEHOLDER POLICY: onnxruntime cannot be imported, so lite_tracking.onnx does NOT run" in run.stdout
    assert "STANDBY → LOCOMOTION" in run.stdout
    assert "Tracking" in run.stdout
