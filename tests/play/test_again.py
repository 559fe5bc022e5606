"""`play --again`: what a recording was made with is played again."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from result import Result

from humanoid_sim.assets import SAMPLE_POLICY, motion_path
from humanoid_sim.errors import InputError
from humanoid_sim.messages import SessionHeader
from humanoid_sim.play.again import again
from humanoid_sim.play.config import PlayConfig
from humanoid_sim.policy.motion import parse_motion, read_motion
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.recording.recorder import McapRecorder

MOTION = motion_path("drum").read_bytes()


def recording(folder: Path, settings: object, motion: bytes | None = MOTION) -> str:
    """A file with a header and nothing else."""
    path = folder / "run.mcap"
    attachments = {} if motion is None else {"motion.mcap": motion}
    recorder = McapRecorder(path)
    recorder.start(SessionHeader("lite", ("a",), 0.02, 0, {"settings": json.dumps(settings)}, attachments))
    recorder.close()
    return str(path)


def test_without_a_recording_nothing_changes() -> None:
    assert again(PlayConfig()) == PlayConfig()


def test_what_was_recorded_takes_the_place_of_defaults(tmp_path: Path) -> None:
    options = {
        "policy": "x.onnx",
        "robot": "lite_neck",
        "command": "1,0,0",
        "yaw": 2,
        "viewer": "native",
        "record": "r",
    }
    path = recording(tmp_path, {"options": options})
    config = PlayConfig(again=path, robot="lite_biped")
    expected = replace(config, policy="x.onnx", command="1,0,0", yaw=2, motion=path)
    assert again(config) == expected


def test_a_motion_that_is_given_counts_more(tmp_path: Path) -> None:
    assert again(PlayConfig(again=recording(tmp_path, {"options": {}}), motion="reach")).motion == "reach"
    assert again(PlayConfig(again=recording(tmp_path, {"options": {}}, None))).motion is None


def test_the_motion_of_a_recording_is_read_as_its_own_file_is(tmp_path: Path) -> None:
    own, carried = read_motion(motion_path("drum")), read_motion(recording(tmp_path, {}))
    assert carried.frames.tobytes() == own.frames.tobytes()
    assert (carried.body_names, carried.policy_dt) == (own.body_names, own.policy_dt)


@pytest.mark.parametrize("settings", [{}, {"options": 3}, [], None])
def test_a_recording_that_does_not_say_what_it_was_made_with(tmp_path: Path, settings: object) -> None:
    path = recording(tmp_path, settings)
    with pytest.raises(InputError, match=f"--again: '{path}' does not say what it was made with"):
        again(PlayConfig(again=path))


@pytest.mark.parametrize("options", [{"policy": ["x"]}, {"yaw": "north"}, {"base_height": {}}])
def test_options_that_are_none(tmp_path: Path, options: dict[str, object]) -> None:
    with pytest.raises(InputError, match="which is no such option"):
        again(PlayConfig(again=recording(tmp_path, {"options": options})))


def test_a_file_that_is_no_recording(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file, expected a recording"):
        again(PlayConfig(again=str(tmp_path / "none.mcap")))
    with pytest.raises(InputError, match="no recording of this program"):
        again(PlayConfig(again=str(motion_path("drum"))))


def test_a_failure_that_regress_found_is_played_again(folder: Path, quick: str, run: Callable[..., Result]) -> None:
    """With the options that regress writes: the policy walks up and follows the motion that the file carries."""
    options = {"policy": str(SAMPLE_POLICY), "robot": quick, "actuation": "affine", "action_limit": 100.0}
    path = recording(folder, {"options": options})
    result = run("--again", path, "--duration", "4")
    assert result.status == 0
    assert "LOCOMOTION" in result.modes
    assert parse_motion(open_recording(folder / "r.mcap").header.attachments["motion.mcap"], "motion").duration == 7.0
