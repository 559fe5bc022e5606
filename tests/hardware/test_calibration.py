"""The calibration file, and the offsets from sweeps."""

import math
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.calibration import (
    CalibrationEntry,
    Sweep,
    SweepResult,
    Verdict,
    evaluate,
    load_calibration,
    save_calibration,
)
from humanoid_sim.robots.description import load_robot

_LITE = load_robot("lite")
_FILE = """\
left_elbow_pitch: {id: 14, direction: -1, homing_offset: 0.25}
left_shoulder_yaw: {id: 13, direction: 1, homing_offset: -2}
"""


def _written(folder, text):
    path = folder / "calibration.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def _whole():
    return {
        joint.name: CalibrationEntry(joint.motor.can_id, joint.motor.direction, 0.1 * i)
        for i, joint in enumerate(_LITE.joints)
        if joint.motor is not None
    }


def test_a_file_is_read_as_it_stands(tmp_path):
    calibration = load_calibration(_written(tmp_path, _FILE), _LITE)
    assert calibration.entries == {
        "left_elbow_pitch": CalibrationEntry(14, -1, 0.25),
        "left_shoulder_yaw": CalibrationEntry(13, 1, -2.0),
    }
    assert calibration.warnings == ()


def test_what_is_written_is_read_again(tmp_path):
    path = tmp_path / "calibration.yaml"
    save_calibration(path, _whole())
    calibration = load_calibration(path, _LITE)
    offsets = calibration.homing_offsets(_LITE)
    assert tuple(offsets) == _LITE.joint_names
    assert offsets["right_wrist_pitch"] == pytest.approx(1.3)
    assert list(tmp_path.iterdir()) == [path]


@given(st.floats(-25.0, 25.0))
def test_any_offset_survives_the_file(offset):
    import tempfile  # noqa: PLC0415 - Hypothesis runs one test many times, so that tmp_path would be shared

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "calibration.yaml"
        save_calibration(path, {"left_elbow_pitch": CalibrationEntry(14, -1, offset)})
        read = load_calibration(path, _LITE).entries["left_elbow_pitch"].homing_offset
    assert abs(read - offset) <= 0.5000001e-6


def test_joints_that_are_not_calibrated_are_named(tmp_path):
    calibration = load_calibration(_written(tmp_path, _FILE), _LITE)
    with pytest.raises(
        InputError, match=r"^calibration: lacks left_shoulder_pitch, left_shoulder_roll, left_wrist_yaw"
    ):
        calibration.homing_offsets(_LITE)


def test_a_neck_that_is_not_mounted_is_kept_and_not_used(tmp_path):
    text = "neck_yaw: {id: 31, direction: 1, homing_offset: 0.5}\n"
    calibration = load_calibration(_written(tmp_path, text), _LITE)
    assert calibration.entries["neck_yaw"].homing_offset == 0.5
    assert calibration.warnings[0].endswith("neck_yaw: is not a driven joint of lite; its entry is not used")


def test_the_robot_descriptions_direction_is_used_and_said(tmp_path):
    text = _FILE.replace("direction: -1", "direction: 1")
    (warning,) = load_calibration(_written(tmp_path, text), _LITE).warnings
    assert "left_elbow_pitch: direction: is 1, the robot description has -1, which is used" in warning


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected a mapping from joint names to id, direction, homing_offset"),
        ("[1, 2]", "expected a mapping from joint names"),
        ("1: {id: 1}", "expected a mapping from joint names"),
        ("a: 3", "a: is 3, expected a mapping with id, direction, homing_offset"),
        ("a: {id: 1, direction: 1}", "a: misses 'homing_offset'; expected"),
        ("a: {id: 1, direction: 1, homing_offset: 0, x: 1}", "a: unknown field 'x'; expected"),
        ("a: {id: 0, direction: 1, homing_offset: 0}", "a: id: is 0, expected a whole number of 1 to 255"),
        ("a: {id: true, direction: 1, homing_offset: 0}", "a: id: is True, expected a whole number"),
        ("a: {id: 1, direction: 0, homing_offset: 0}", "a: direction: is 0, expected 1 or -1"),
        ("a: {id: 1, direction: 1, homing_offset: .nan}", "a: homing_offset: is nan, expected a number within ±25.13"),
        ("a: {id: 1, direction: 1, homing_offset: 30}", "a: homing_offset: is 30, expected a number within ±25.13"),
        ("a: {id: 1, direction: 1, homing_offset: x}", "a: homing_offset: is 'x', expected a number"),
        (_FILE.replace("14", "15"), "left_elbow_pitch: id: is 15, the motor of lite's joint is 14"),
        (_FILE + _FILE, "line 3, column 1: not valid YAML: 'left_elbow_pitch' is given twice"),
        ("a: [", "not valid YAML"),
        ("a: [1, 2]", "a: is a list, expected a mapping"),
        ("a: {id: 0x" + "f" * 5000 + ", direction: 1, homing_offset: 0}", "a: id: is a number of 20000 bits, expected"),
        (
            "a: {id: 1, direction: 1, homing_offset: 0x" + "f" * 5000 + "}",
            "a: homing_offset: is a number of 20000 bits",
        ),
    ],
)
def test_files_that_are_no_calibration(tmp_path, text, message):
    path = _written(tmp_path, text)
    with pytest.raises(InputError) as raised:
        load_calibration(path, _LITE)
    assert message in str(raised.value)
    assert str(raised.value).startswith(f"{path}: ")
    assert "\n" not in str(raised.value)


def test_paths_that_are_no_file(tmp_path):
    for path, message in ((tmp_path / "none.yaml", "no such file"), (tmp_path, "is a directory")):
        with pytest.raises(InputError, match=f"{message}, expected a calibration"):
            load_calibration(path, _LITE)


def test_bytes_that_are_no_text(tmp_path):
    path = tmp_path / "calibration.yaml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="is not a text file"):
        load_calibration(path, _LITE)


def test_a_write_that_fails_leaves_the_old_file(tmp_path, monkeypatch):
    path = _written(tmp_path, _FILE)

    def no_space(descriptor):
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(os, "fsync", no_space)
    with pytest.raises(InputError, match="cannot be written: No space left on device"):
        save_calibration(path, _whole())
    assert path.read_text(encoding="utf-8") == _FILE
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="cannot be written: No such file or directory"):
        save_calibration(tmp_path / "none" / "calibration.yaml", _whole())


def test_a_replaced_file_keeps_its_permissions(tmp_path):
    path = _written(tmp_path, _FILE)
    path.chmod(0o640)
    save_calibration(path, _whole())
    assert path.stat().st_mode & 0o777 == 0o640
    assert math.isclose(load_calibration(path, _LITE).entries["left_shoulder_roll"].homing_offset, 0.1)


_ELBOW = _LITE.joints[3]  # -2.35619 to 0
_YAW = _LITE.joints[2]  # ±1.5708


def _swept(joint, direction, offset, turns=0):
    """A sweep of the whole range of a joint whose motor has this offset and counts these turns too many."""
    sweep = Sweep()
    for angle in (0.5 * (joint.lower + joint.upper), joint.lower, joint.upper):
        motor = direction * angle + offset + 2.0 * math.pi * turns
        sweep = sweep.with_angle(direction * motor)
    return sweep


def _verdict(joint, direction, sweep, any_offset=False):
    return evaluate(joint, direction, sweep, threshold=0.5, tolerance=0.2, any_offset=any_offset)


@given(st.sampled_from(_LITE.joints), st.sampled_from((-1, 1)), st.floats(-0.5, 0.5), st.integers(-2, 2))
def test_a_sweep_from_stop_to_stop_gives_the_offset_on_any_turn(joint, direction, offset, turns):
    result = _verdict(joint, direction, _swept(joint, direction, offset, turns))
    assert result.verdict is Verdict.GOOD
    assert result.homing_offset == pytest.approx(offset, abs=1e-9)
    assert result.width == pytest.approx(joint.upper - joint.lower)


@given(st.floats(-math.pi, math.pi))
def test_motors_assembled_anywhere_are_calibrated_when_that_is_said(offset):
    result = _verdict(_ELBOW, 1, _swept(_ELBOW, 1, offset), any_offset=True)
    assert math.cos(result.homing_offset - offset) == pytest.approx(1.0)


def test_a_short_sweep_within_the_limits_is_not_flipped():
    result = evaluate(_ELBOW, -1, Sweep(-0.12, -0.1), threshold=0.0, tolerance=0.2, any_offset=False)
    assert result.verdict is Verdict.INCOMPLETE


def test_a_symmetric_joint_does_not_show_its_direction():
    flipped = Sweep().with_angle(-1.5708).with_angle(1.5708)
    assert _verdict(_YAW, -1, flipped).verdict is Verdict.GOOD


def test_a_joint_that_was_not_moved_is_not_swept():
    assert _verdict(_YAW, 1, Sweep()) == SweepResult(Verdict.UNSWEPT, 0.0, None)
    assert _verdict(_YAW, 1, Sweep(0.1, 0.59)).verdict is Verdict.UNSWEPT


@pytest.mark.parametrize(
    ("upper", "verdict"), [(1.2, Verdict.INCOMPLETE), (1.9, Verdict.BEYOND), (9.0, Verdict.BEYOND)]
)
def test_a_sweep_that_is_not_the_joints_range_gives_no_offset(upper, verdict):
    result = _verdict(_YAW, 1, Sweep(-1.5708, upper))
    assert (result.verdict, result.homing_offset) == (verdict, None)


def test_the_formula_of_the_reference():
    joint, sweep = _LITE.joints[0], Sweep(-3.0, 1.0)
    assert _verdict(joint, -1, sweep).homing_offset == pytest.approx(
        -0.5 * ((-3.0 - joint.lower) + (1.0 - joint.upper))
    )


def test_angles_that_are_none_change_nothing():
    assert Sweep(1.0, 2.0).with_angle(math.nan) == Sweep(1.0, 2.0)
    assert Sweep().with_angle(0.5).with_angle(math.inf) == Sweep(0.5, 0.5)
