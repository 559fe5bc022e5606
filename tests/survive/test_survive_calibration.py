"""A `calibration.yaml` that was written before reads as it was written."""

from pathlib import Path

import pytest
from control_surface import INPUT_ERRORS, load_calibration

DATA = Path(__file__).parents[1] / "data" / "survive"
DIRECTIONS = [-1, -1, 1, -1, 1, -1, -1, 1, -1, 1, 1, 1, 1, -1]
JOINTS = [
    f"{side}_{name}"
    for side in ("left", "right")
    for name in (
        *("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow_pitch"),
        *("wrist_yaw", "wrist_roll", "wrist_pitch"),
    )
]
ROBSTRIDE = [
    *(-2.568975, 6.283185, 1.867902, 0.0, 0.000013, -0.414613, -0.129882),
    *(-2.109619, 1.454378, -2.395233, -0.674385, 0.103789, -0.430106, -12.5),
]
SITO = [-0.7, -0.6, -0.5, -0.4, -0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6]


@pytest.mark.parametrize(
    ("file", "robot", "offsets", "more"),
    [
        ("calibration.yaml", "lite", ROBSTRIDE, {"neck_yaw": (31, 1, -0.5)}),  # a neck that is not mounted
        ("calibration_sito.yaml", "lite_sito", SITO, {}),
    ],
)
def test_a_calibration_reads_as_it_was_written(file, robot, offsets, more):
    entries, homing_offsets = load_calibration(DATA / file, robot)
    ids = [*range(11, 18), *range(21, 28)]
    assert entries == dict(zip(JOINTS, zip(ids, DIRECTIONS, offsets, strict=True), strict=True)) | more
    assert list(homing_offsets.items()) == list(zip(JOINTS, offsets, strict=True)), "by the robot's joints, in order"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("homing_offset: 0.0", "homing_ofset: 0.0", ["left_elbow_pitch", "homing_offset"]),
        ("homing_offset: 0.0", "homing_offset: 0.0\n  turns: 1", ["left_elbow_pitch", "turns"]),
        ("homing_offset: 0.0", "homing_offset: .nan", ["left_elbow_pitch", "homing_offset", "nan"]),
        ("homing_offset: 0.0", "homing_offset: .inf", ["left_elbow_pitch", "homing_offset", "inf"]),
        ("homing_offset: 0.0", "homing_offset: 57.3", ["left_elbow_pitch", "homing_offset", "57.3"]),
        ("homing_offset: 0.0", "homing_offset: zero", ["left_elbow_pitch", "homing_offset", "zero"]),
        ("id: 14", "id: 0", ["left_elbow_pitch", "id", "0"]),
        ("id: 14", "id: 24", ["left_elbow_pitch", "id", "24"]),
        ("id: 14", "", ["left_elbow_pitch", "id"]),
        ("id: 14\n  direction: -1", "id: 14\n  direction: 0", ["left_elbow_pitch", "direction", "0"]),
        ("left_wrist_yaw", "left_elbow_pitch", ["left_elbow_pitch"]),  # one joint twice
        ("left_elbow_pitch:", "left_elbow:", ["left_elbow_pitch"]),  # a joint without an offset
    ],
)
def test_a_wrong_entry_is_refused_with_its_name(tmp_path, old, new, words):
    text = (DATA / "calibration.yaml").read_text(encoding="utf-8")
    assert text.count(old) == 1
    path = tmp_path / "calibration.yaml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(INPUT_ERRORS) as refused:
        load_calibration(path, "lite")
    for word in words:
        assert word in str(refused.value)
