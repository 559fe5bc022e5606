"""Names that were probably meant."""

import pytest

from humanoid_sim.errors import meant


@pytest.mark.parametrize(
    ("name", "known", "expected"),
    [
        ("LEFT_HIP_PITCH_JOINT", ("left_hip_pitch_joint",), "left_hip_pitch_joint"),
        ("left_shoulder_pitch", ("left_ankle_pitch", "left_hip_pitch"), ""),
        ("left_knee", ("right_knee",), ""),
        ("g1/left_knee", ("left_knee", "right_knee"), "left_knee"),
        ("left_knee", ("g1_left_knee", "g1_right_knee"), "g1_left_knee"),
        ("knee", ("left_knee", "right_knee"), ""),
    ],
)
def test_a_near_name_is_one_that_can_be_meant(name, known, expected):
    assert meant(name, known) == (f" (did you mean '{expected}'?)" if expected else "")
