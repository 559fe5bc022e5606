"""Faults as a person writes them, and what is refused."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.emulation.faults import FAULTS, Fault, parse_fault
from humanoid_sim.robots.description import load_robot

LITE = load_robot("lite")
JOINTS = LITE.joint_names


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("silent", Fault("silent")),
        ("silent:14", Fault("silent", ("left_elbow_pitch",))),
        ("lost=0.2:left_elbow_pitch,24", Fault("lost", ("left_elbow_pitch", "right_elbow_pitch"), value=0.2)),
        (
            "over_temperature=150:left_elbow_pitch@5+2",
            Fault("over_temperature", ("left_elbow_pitch",), 5.0, 2.0, 150.0),
        ),
        ("encoder_jump=-1e-1@.5", Fault("encoder_jump", (), 0.5, math.inf, -0.1)),
        (" bus_off@3 ", Fault("bus_off", start=3.0)),
    ],
)
def test_what_is_read(text, fault):
    assert parse_fault(text, LITE) == fault


@given(
    st.sampled_from(sorted(FAULTS)),
    st.lists(st.sampled_from(JOINTS), unique=True),
    st.floats(0, 1e4).map(lambda x: round(x, 2)),
    st.none() | st.floats(0.01, 1e4).map(lambda x: round(x, 2)),
)
def test_what_is_written_is_read_again(kind, joints, start, duration):
    fault = Fault(kind, tuple(joints), start, duration or math.inf)
    again = parse_fault(str(fault), LITE)
    assert (again.kind, again.joints) == (kind, tuple(joints))
    assert again.start == pytest.approx(start, rel=1e-4)
    assert again.duration == pytest.approx(fault.duration, rel=1e-4)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "--fault: is '', expected KIND[=VALUE][:MOTOR,…][@START[+DURATION]]"),
        ("silent@", "--fault: is 'silent@', expected KIND"),
        ("silent:14@x", "--fault: is 'silent:14@x', expected KIND"),
        ("broken", "--fault 'broken': unknown fault 'broken'; known: lost, delayed"),
        ("silent=3", "--fault 'silent=3': fault 'silent': takes no value, but is given 3"),
        ("lost=1.5", "--fault 'lost=1.5': fault 'lost': value is 1.5 probability, expected 0 to 1"),
        (
            "corrupted_id=2.5",
            "--fault 'corrupted_id=2.5': fault 'corrupted_id': value is 2.5 bit, expected a whole number",
        ),
        ("silent:elbow", "--fault 'silent:elbow': unknown joint 'elbow'; known: left_shoulder_pitch"),
        ("silent:99", "--fault 'silent:99': unknown CAN id '99'; known: 11, 12"),
        ("silent@1+0", "--fault 'silent@1+0': fault 'silent': lasts 0.0 s, expected more than 0"),
    ],
)
def test_what_is_refused_is_one_line(text, problem):
    with pytest.raises(InputError) as caught:
        parse_fault(text, LITE)
    assert str(caught.value).startswith(problem)
    assert "\n" not in str(caught.value)
