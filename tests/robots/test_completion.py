"""Robot files that change single fields of an MJCF."""

import math

import msgspec
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot


def robot(hopper, text):
    path = hopper.with_name("mine.yaml")
    path.write_text(f"mjcf: hopper.xml\n{text}")
    return load_robot(path)


def test_nothing_but_the_mjcf_is_the_robot_of_the_mjcf(hopper):
    assert robot(hopper, "") == load_robot(hopper)
    assert robot(hopper, "").has_no_gains


def test_single_fields(hopper):
    text = """
imu: thigh
base: {height: 0.7}
simulation: {physics_timestep: 0.0005, joint_damping: drop}
standby_controller_a: {segment_durations: [0.5]}
initial_position: {knee: 0.6}
joints: {hip: {effort_limit: 12, upper: 0.8}}
"""
    changed, plain = robot(hopper, text), load_robot(hopper)
    assert changed.imu == "thigh"
    assert (changed.base.type, changed.base.body, changed.base.height) == ("floating", "trunk", 0.7)
    assert (changed.simulation.physics_timestep, changed.simulation.joint_damping) == (0.0005, "drop")
    assert changed.simulation.control_frequency == 200.0
    assert changed.initial_position == (0.0, 0.6)
    assert changed.standby_controller_a.segment_durations == (0.5,)
    assert changed.standby_controller_a.pose_segments == changed.standby_controller_b.pose_segments == ((0.0, 0.6),)
    assert changed.joints[0] == msgspec.structs.replace(plain.joints[0], effort_limit=12.0, upper=0.8)
    assert changed.joints[1] == plain.joints[1]


def test_what_the_mjcf_does_not_limit_is_no_mistake_of_the_file(hopper):
    hopper.write_text(hopper.read_text().replace(' range="-1 1"', "").replace('forcerange="-30 40"', ""))
    free = robot(hopper, "imu: trunk\n")
    assert (free.joints[0].lower, free.joints[1].effort_limit) == (-math.inf, math.inf)
    assert robot(hopper, "initial_position: {hip: 5.0}").initial_position == (5.0, 0.2)


def test_a_robot_with_gains_of_its_own(hopper):
    assert not robot(hopper, "joints: {hip: {stiffness: 20, damping: 1}}").has_no_gains


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("joints: {ankle: {effort_limit: 3}}", "joints: unknown joint 'ankle'; known: hip, knee"),
        ("initial_position: {ankle: 3}", "initial_position: unknown joint 'ankle'; known: hip, knee"),
        ("joints: {hip: 3}", "joints.hip: is 3, expected a mapping, such as {effort_limit: 60}"),
        ("joints: {hip: {name: leg}}", "joints.hip.name: is given twice, expected it as the key alone"),
        ("joints: {knee: {effort_limit: -3}}", "joints[1].effort_limit: is -3.0, expected a finite number > 0"),
        ("joints: {knee: {limit: 3}}", "joints[1]: unknown field 'limit'; known: name, lower, "),
        ("initial_position: {knee: 3}", "initial_position[1]: is 3, outside the limits of knee, 0.2 to 2"),
        ("imu_site: torso", "unknown field 'imu_site'; known: name, topic_prefix, mjcf, "),
        ("joints: all", "joints: is 'all', expected a list"),
    ],
)
def test_what_is_wrong_is_named(hopper, text, message):
    with pytest.raises(InputError) as caught:
        robot(hopper, text)
    assert str(caught.value).startswith(f"{hopper.with_name('mine.yaml')}: {message}")


def test_a_missing_mjcf(hopper):
    hopper.unlink()
    with pytest.raises(InputError, match=r"mine.yaml: mjcf: 'hopper.xml' is not a file; it is looked up beside"):
        robot(hopper, "")
