"""The calibration file, and the offsets from sweeps."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.calibration import CalibrationEntry, Verdict, evaluate, load_calibration, save_calibration
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


def test_the_robot_descriptions_direction_is_used_and_said(tmp_path):
    text = _FILE.replace("direction: -1", "direction: 1")
    (warning,) = load_calibration(_written(tmp_path, text), _LITE).warnings
    assert "directions are not those of lite, which are used" in warning
    assert warning.endswith("left_elbow_pitch (+1)")


def test_a_confirmed_direction_needs_no_offset_and_holds_for_that_direction_only(tmp_path):
    text = _FILE + "left_wrist_yaw: {id: 15, direction: 1, direction_confirmed: true}\n"
    text = text.replace("homing_offset: 0.25}", "homing_offset: 0.25, direction_confirmed: true}")
    calibration = load_calibration(_written(tmp_path, text), _LITE)
    assert calibration.entries["left_wrist_yaw"] == CalibrationEntry(15, 1, None, direction_confirmed=True)
    assert set(_LITE.joint_names) - set(calibration.unconfirmed(_LITE)) == {"left_elbow_pitch", "left_wrist_yaw"}
    with pytest.raises(InputError, match=r"calibration\.yaml: lacks .*left_wrist_yaw"):
        calibration.homing_offsets(_LITE)
    turned = load_calibration(_written(tmp_path, text.replace("direction: -1", "direction: 1")), _LITE)
    assert "left_elbow_pitch" in turned.unconfirmed(_LITE)
    save_calibration(tmp_path / "again.yaml", calibration.entries, _LITE.joint_names)
    again = load_calibration(tmp_path / "again.yaml", _LITE).entries
    assert again == calibration.entries
    assert not list(tmp_path.glob("again.yaml?*")), "nothing else is left"
    assert list(again) == ["left_shoulder_yaw", "left_elbow_pitch", "left_wrist_yaw"], "in the robot's order"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["joint names"]),
        ("a: 3", ["a: is 3, expected a mapping"]),
        ("a: {id: 1, direction: 1, homing_offset: 0, direction_confirmed: 1}", ["a: direction_confirmed: is 1"]),
        ("a: {id: 1, direction: 0}", ["a: direction: is 0, expected -1 or 1"]),
        ("a: {id: 1, direction: 1, homing_offset: 57.3}", ["a: homing_offset: is 57.3, expected"]),
        ("a: [", ["not valid YAML"]),
    ],
)
def test_a_file_that_is_no_calibration_is_refused_with_field_and_value(tmp_path, text, words):
    path = _written(tmp_path, text)
    with pytest.raises(InputError) as refused:
        load_calibration(path, _LITE)
    assert all(word in str(refused.value) for word in [str(path), *words])


_ELBOW = _LITE.joints[3]  # -2.35619 to 0
_YAW = _LITE.joints[2]  # ±1.5708


def _swept(joint, direction, offset, turns=0):
    """A sweep of the whole range of a joint whose motor has this offset and counts these turns too many."""
    shift = direction * (offset + 2.0 * math.pi * turns)
    return joint.lower + shift, joint.upper + shift


def _verdict(joint, direction, sweep, any_offset=False):
    return evaluate(joint, direction, sweep, tolerance=0.2, any_offset=any_offset)


@given(st.sampled_from(_LITE.joints), st.sampled_from((-1, 1)), st.floats(-0.5, 0.5), st.integers(-2, 2))
def test_a_sweep_from_stop_to_stop_gives_the_offset_on_any_turn(joint, direction, offset, turns):
    sweep = _swept(joint, direction, offset, turns)
    verdict, found = _verdict(joint, direction, sweep)
    assert verdict is Verdict.GOOD
    assert found == pytest.approx(offset, abs=1e-6)


@given(st.floats(-math.pi, math.pi))
def test_motors_assembled_anywhere_are_calibrated_when_that_is_said(offset):
    _, found = _verdict(_ELBOW, 1, _swept(_ELBOW, 1, offset), any_offset=True)
    assert math.cos(found - offset) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("upper", "verdict"),
    [(-1.2, Verdict.UNSWEPT), (1.2, Verdict.INCOMPLETE), (1.9, Verdict.BEYOND), (9.0, Verdict.BEYOND)],
)
def test_a_sweep_that_is_not_the_joints_range_gives_no_offset(upper, verdict):
    assert _verdict(_YAW, 1, (-1.5708, upper)) == (verdict, None)
