import pytest

from humanoid_sim.errors import known_names
from humanoid_sim.names import near_miss


@pytest.mark.parametrize(
    ("name", "known", "meant"),
    [
        ("left_knee", ["right_knee", "left_knee_joint"], "left_knee_joint"),
        ("LeftKnee", ["left_ankle"], ""),
        ("robot/left_knee", ["left_knee"], "left_knee"),
        ("l_knee", ["right_knee", "left_knee"], "left_knee"),
        ("left_knee", ["right_knee"], ""),
        (
            "left_shoulder_pich_joint",
            ["left_shoulder_pitch_joint", "right_shoulder_pitch_joint"],
            "left_shoulder_pitch_joint",
        ),
        ("torso", ["torso_link"], "torso_link"),
        ("x", [], ""),
        ("plya", ["play", "replay"], "play"),
        ("--robt", ["--robot", "--record"], "--robot"),
        ("Lite-Biped", ["lite", "lite_biped"], "lite_biped"),
        ("rs-09", ["rs-00", "rs-04"], ""),
        ("eth7", ["lo", "eth1"], ""),
        ("rs_2", ["rs-2"], "rs-2"),
        ("sb3-ppo", ["ppo-rsl_rl", "ppo-sb3"], "ppo-sb3"),
        ("dance", ["play", "replay"], ""),
        ("right_elbw", ["left_elbow"], ""),
    ],
)
def test_near_misses(name, known, meant):
    assert near_miss(name, known) == meant


def test_pairs_may_be_asked_to_be_closer():
    assert near_miss("plya", ["play"], 0.85) == ""


def test_a_message():
    assert known_names("joint", "elbw", ["elbow", "wrist"]) == (
        "unknown joint 'elbw' (did you mean 'elbow'?); known: elbow, wrist"
    )
    assert known_names("joint", "x", ["elbow"]) == "unknown joint 'x'; known: elbow"
    assert known_names("joint", "x", []) == "unknown joint 'x'; known: none"
    assert (
        known_names("option", "elbw", ["elbow", "wrist"], listed=False)
        == "unknown option 'elbw' (did you mean 'elbow'?)"
    )
