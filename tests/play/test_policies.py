import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import models
import numpy as np
import pytest

from humanoid_sim.assets import SAMPLE_POLICY, motion_path
from humanoid_sim.errors import InputError
from humanoid_sim.messages import SessionHeader
from humanoid_sim.play import policies
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.play.policies import choose_policy, with_recorded_options
from humanoid_sim.policy.motion import Motion, read_motion, write_motion
from humanoid_sim.policy.onnx_policy import OnnxPolicy
from humanoid_sim.recording.recorder import McapRecorder
from humanoid_sim.robots.description import load_robot

LITE = load_robot("lite")


@pytest.mark.parametrize(
    ("policy", "robot", "followed"),
    [
        ("lite_tracking", "lite", "wave"),
        ("lite_piano", "lite_piano", "ode_to_joy"),
        ("lite_biped_velocity", "lite_biped", None),
    ],
)
def test_a_policy_that_ships_goes_by_its_name_and_follows_what_is_its_default(policy, robot, followed):
    for config in (PlayConfig(policy=policy), PlayConfig(shadow=policy)):
        choice = choose_policy(config, load_robot(robot))
        assert Path(choice.checkpoint.source).name == f"{policy}.onnx"
        assert (choice.motion_file and choice.motion_file.stem) == followed


def test_a_policys_path_does_not_make_it_the_sample():
    with pytest.raises(InputError, match=r"^--motion: is missing; "):
        choose_policy(PlayConfig(policy=str(SAMPLE_POLICY)), LITE)


def test_on_hardware_an_inference_ends_before_the_motors_stop_by_themselves():
    for hardware, limit in ((None, 10.0), ("virtual:lite", 0.1)):
        choice = choose_policy(PlayConfig(policy="lite_tracking", hardware=hardware, can_timeout=0.2), LITE)
        policy = choice.checkpoint.policy
        assert isinstance(policy, OnnxPolicy)
        assert policy.model.time_limit == limit


def test_a_policy_of_the_users_needs_a_motion_and_says_which_dataset_it_was_made_for(tmp_path):
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


def test_without_onnxruntime_zeros_stand_in_and_say_so(monkeypatch):
    monkeypatch.setattr(policies, "has_onnxruntime", lambda: False)
    choice = choose_policy(PlayConfig(), LITE)
    assert choice.warning == (
        "PLACEHOLDER POLICY: onnxruntime cannot be imported, so lite_tracking.onnx does NOT run; "
        "the action is zero. To run it: pip install onnxruntime"
    )
    assert choice.motion is not None
    width = choice.loaded.layout.width
    assert np.asarray(choice.loaded.policy(np.ones(width, dtype=np.float32), 3)).tolist() == [0.0] * 14


def test_a_run_without_onnxruntime_goes_on_loudly(tmp_path, quick):
    blocked = tmp_path / "blocked"
    blocked.mkdir()
    (blocked / "onnxruntime.py").write_text("raise ImportError('no shared library')\n", encoding="utf-8")
    options = ("--viewer", "none", "--record", "none", "--robot", quick, "--motion", "reach", "--policy-seconds", "0.5")
    run = subprocess.run(
        [sys.executable, "-m", "humanoid_sim.play", *options],
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


MOTION = motion_path("drum").read_bytes()


def recording(folder, settings, motion=MOTION):
    """A file with a header and nothing else."""
    path = folder / "run.mcap"
    attachments = {} if motion is None else {"motion.mcap": motion}
    recorder = McapRecorder(path)
    recorder.start(SessionHeader("lite", ("a",), 0.02, 0, {"settings": json.dumps(settings)}, attachments))
    recorder.close()
    return str(path)


def test_what_was_recorded_takes_the_place_of_defaults(tmp_path):
    options = {
        "policy": "x.onnx", "robot": "lite_neck", "command": "1,0,0", "yaw": 2, "viewer": "native", "record": "r",
    }  # fmt: skip
    path = recording(tmp_path, {"options": options})
    config = PlayConfig(again=path, robot="lite_biped")
    expected = replace(config, policy="x.onnx", command="1,0,0", yaw=2, motion=path)
    assert with_recorded_options(config) == expected


def test_a_motion_that_is_given_counts_more(tmp_path):
    assert (
        with_recorded_options(PlayConfig(again=recording(tmp_path, {"options": {}}), motion="reach")).motion == "reach"
    )
    assert with_recorded_options(PlayConfig(again=recording(tmp_path, {"options": {}}, None))).motion is None


def test_the_motion_of_a_recording_is_read_as_its_own_file_is(tmp_path):
    own, carried = read_motion(motion_path("drum")), read_motion(recording(tmp_path, {}))
    assert carried.frames.tobytes() == own.frames.tobytes()
    assert (carried.body_names, carried.policy_dt) == (own.body_names, own.policy_dt)


@pytest.mark.parametrize("settings", [{}, {"options": 3}, [], None])
def test_a_recording_that_does_not_say_what_it_was_made_with(tmp_path, settings):
    path = recording(tmp_path, settings)
    with pytest.raises(InputError, match=f"--again: '{path}' does not say what it was made with"):
        with_recorded_options(PlayConfig(again=path))


@pytest.mark.parametrize("options", [{"policy": ["x"]}, {"yaw": "north"}, {"base_height": {}}])
def test_options_that_are_none(tmp_path, options):
    with pytest.raises(InputError, match="which play does not take"):
        with_recorded_options(PlayConfig(again=recording(tmp_path, {"options": options})))


def test_a_file_that_is_no_recording(tmp_path):
    with pytest.raises(InputError, match="no such file, expected a recording"):
        with_recorded_options(PlayConfig(again=str(tmp_path / "none.mcap")))
    with pytest.raises(InputError, match="no recording of this program"):
        with_recorded_options(PlayConfig(again=str(motion_path("drum"))))


def test_another_policy_comes_with_a_contract_of_its_own(tmp_path):
    path = recording(tmp_path, {"options": {"policy": "old.onnx", "contract": "old.yaml", "robot": "lite_biped"}})
    assert with_recorded_options(PlayConfig(again=path)).contract == "old.yaml"
    other = with_recorded_options(PlayConfig(again=path, policy="new.onnx"))
    assert (other.policy, other.contract, other.robot) == ("new.onnx", None, "lite_biped")
    assert with_recorded_options(PlayConfig(again=path, policy="new.onnx", contract="new.yaml")).contract == "new.yaml"


def test_the_walking_policy_is_the_default_of_simulated_legs():
    assert choose_policy(PlayConfig(robot="lite_biped"), load_robot("lite_biped")).source.endswith(
        "lite_biped_velocity.onnx"
    )


def test_on_hardware_no_policy_runs_that_nobody_named():
    for config in (PlayConfig(hardware="virtual:lite"), PlayConfig(policy="none")):
        choice = choose_policy(config, LITE)
        assert (choice.loaded, choice.source, choice.walks) == (None, "none", False)
