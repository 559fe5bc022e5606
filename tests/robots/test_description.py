"""Robot files: what is accepted, what is refused with its field, and a robot as a policy's contract wants it."""

import copy
import math
import re

import msgspec
import numpy as np
import pytest
import yaml
from models import contract_of

from humanoid_sim.assets import asset_path, shipped
from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import (
    RobotDescription,
    load_robot,
    with_contract,
    with_contract_physics,
)

LITE = yaml.safe_load(asset_path("robots", "lite.yaml").read_text())
BIPED = load_robot("lite_biped")
N = BIPED.joint_count


def write(folder, document):
    path = folder / "robot.yaml"
    path.write_text(document if isinstance(document, str) else yaml.safe_dump(document))
    return path


def refusal(path):
    """The one line that says what is wrong with a file, without the file."""
    with pytest.raises(InputError) as caught:
        load_robot(path)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(f"{path}: ")
    return text.removeprefix(f"{path}: ")


@pytest.fixture
def document():
    """The Lite's description as plain data, its MJCF by absolute path."""
    return copy.deepcopy(LITE) | {"mjcf": str(asset_path("mjcf", "lite.xml").resolve())}


def set_at(document, place, value):
    """Set the value at a place such as `joints[3].upper`."""
    *keys, last = [int(key) if key.isdigit() else key for key in re.findall(r"[^.\[\]]+", place)]
    for key in keys:
        document = document.setdefault(key, {}) if isinstance(key, str) else document[key]
    document[last] = value


PER_JOINT = "expected 14, one per joint"
STANDBY = "standby_controller_a"
SITO = {"bus": 0, "can_id": 17, "model": "TA40-50", "direction": -1}
BAD_VALUES = [
    ("mjcf", "nowhere.xml", "mjcf: is 'nowhere.xml', expected the name of an MJCF"),
    ("joints[3].lower", math.nan, "joints[3].lower: is nan, expected a finite number"),
    (
        "joints[3].lower",
        -135.0,
        "lower: is more than the motor's range for left_elbow_pitch (135, at most 12.5664); is",
    ),
    (
        "joints[4].effort_limit",
        17.0,
        "effort_limit: is more than the motor's range for left_wrist_yaw (17, at most 5.5)",
    ),
    ("joints[4].stiffness", 600.0, "stiffness: is more than the motor's range for left_wrist_yaw (600, at most 500)"),
    ("damping_controller", {"damping_scalar": 6.0}, "damping_controller: is more than the motor's range for left_sh"),
    ("hardware.rx_timeout_ms", 15, "hardware.rx_timeout_ms: is 15, expected more than the control period of 20 ms"),
    ("hardware.rx_timeout_ms", 60000, "hardware.rx_timeout_ms: is 60000, expected `float` <= 1000.0"),
    ("joints[1].motor.direction", 0, "joints[1].motor.direction: is 0, expected -1 or 1"),
    ("joints[3].upper", -3.0, "joints[3].upper: is -3, expected more than lower, which is -2.35619"),
    ("joints[1].motor.can_id", 11, "joints[1].motor.can_id: is 11, which is the id of joints[0]"),
    ("joints[6].motor.family", "sito", "joints[6].motor.family: is sito, but a rs-05 is of robstride"),
    ("joints[6].motor.model", "rs-20", "joints[6].motor.model: unknown motor model 'rs-20'"),
    ("joints[6].motor.torque_limit", None, "joints[6].motor: misses 'torque_limit'"),
    ("joints[6].motor", SITO | {"can_id": 200}, "joints[6].motor.can_id: is 200, expected 1 to 127 beside robstride"),
    ("initial_position[3]", 0.1, "initial_position[3]: is 0.1, outside the limits of left_elbow_pitch, -2.35619 to 0"),
    ("simulation.physics_timestep", 0.0006, "simulation.physics_timestep: 0.0006 s does not divide"),
    ("base", {"type": "floating"}, "base.body: is empty"),
    (f"{STANDBY}.pose_segments", [[0.0] * 14], f"{STANDBY}.pose_segments: has 1 poses, expected 2"),
    ("stifness", 1.0, "unknown field 'stifness'; known: name, "),
]


@pytest.mark.parametrize(("place", "value", "problem"), BAD_VALUES)
def test_a_bad_value_is_named(tmp_path, document, place, value, problem):
    set_at(document, place, value)
    assert refusal(write(tmp_path, document)).startswith(problem)


def test_all_that_is_wrong_is_reported_at_once(tmp_path, document):
    document["initial_position"] = [0.0]
    document["joints"][3]["motor"]["can_id"] = 9  # the last byte of a Sito command's identifier
    document["joints"][6]["motor"] = SITO
    text = refusal(write(tmp_path, document))
    assert "initial_position: has 1 values" in text
    assert "joints[3].motor.can_id: is 9, which frames to sito motors" in text


def test_what_is_no_description_or_robot(tmp_path):
    for text in ("", "name: lite\n"):
        assert refusal(write(tmp_path, text)).startswith("mjcf: is None, expected")
    assert refusal(tmp_path).startswith("is a directory, expected a robot's YAML file, an MJCF or one of: lite, ")
    with pytest.raises(InputError, match=r"^unknown robot 'lit' \(did you mean 'lite'\?\); known: lite, lite_biped, "):
        load_robot("lit")


@pytest.mark.peers
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("robot_descriptions:unitree_g1", "known: g1"),
        ("robot_descriptions:talso", "did you mean 'talos'?"),
        ("robot_descriptions:zzzz", "known: a1, "),
        ("mine", "or a file that exists"),
    ],
)
def test_a_wrong_name_of_a_public_robot_gives_the_near_ones_in_one_line(name, message):
    pytest.importorskip("robot_descriptions")
    with pytest.raises(InputError) as caught:
        load_robot(name)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", shipped("robots"))
def test_a_shipped_robot_survives_json(name):
    robot = load_robot(name)
    text = robot.to_json()
    assert "\n" not in text
    assert RobotDescription.from_json(text, folder=robot.folder) == robot
    assert RobotDescription.from_json(text).mjcf_path == robot.mjcf_path, "a recording finds a shipped robot's model"
    with pytest.raises(InputError, match=r"^robot description \(JSON\): "):
        RobotDescription.from_json(text[:-1])


def completed(hopper, text):
    return load_robot(write(hopper.parent, f"mjcf: hopper.xml\n{text}"))


def test_a_file_may_change_single_fields_of_its_mjcf(hopper):
    text = """
imu: thigh
base: {height: 0.7}
simulation: {joint_damping: drop}
standby_controller_a: {segment_durations: [0.5]}
initial_position: {knee: 0.6}
joints: {hip: {effort_limit: 12, upper: 0.8}}
"""
    changed, plain = completed(hopper, text), load_robot(hopper)
    assert completed(hopper, "") == plain
    assert (changed.imu, changed.base.body, changed.base.height) == ("thigh", "trunk", 0.7)
    assert (changed.simulation.physics_timestep, changed.simulation.joint_damping) == (0.001, "drop")
    assert changed.initial_position == (0.0, 0.6)
    assert changed.standby_controller_a.segment_durations == (0.5,)
    assert changed.standby_controller_a.pose_segments == changed.standby_controller_b.pose_segments == ((0.0, 0.6),)
    assert changed.joints[0] == msgspec.structs.replace(plain.joints[0], effort_limit=12.0, upper=0.8)
    assert changed.joints[1] == plain.joints[1]


def test_what_the_mjcf_does_not_limit_is_no_mistake_of_the_file(hopper):
    hopper.write_text(hopper.read_text().replace(' range="-1 1"', "").replace('forcerange="-30 40"', ""))
    free = completed(hopper, "initial_position: {hip: 5.0}")
    assert (free.joints[0].lower, free.joints[1].effort_limit) == (-math.inf, math.inf)
    assert free.initial_position == (5.0, 0.2)
    assert RobotDescription.from_json(free.to_json(), free.folder) == free


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("joints: {ankle: {effort_limit: 3}}", "joints: unknown joint 'ankle'; known: hip, knee"),
        ("joints: {hip: 3}", "joints.hip: is 3, expected fields"),
        ("joints: {knee: {limit: 3}}", "joints.knee: unknown field 'limit'"),
        ("initial_position: {knee: 3}", "initial_position[1]: is 3, outside the limits of knee"),
    ],
)
def test_what_is_wrong_with_a_change_is_named(hopper, text, problem):
    assert refusal(write(hopper.parent, f"mjcf: hopper.xml\n{text}")).startswith(problem)


def contract(joints, *, default_joint_pos=0.01, **fields):
    return contract_of(
        joints,
        joint_stiffness=np.arange(N) + 10.0,
        joint_damping=np.arange(N) * 0.1,
        default_joint_pos=np.broadcast_to(default_joint_pos, N),
        observation=("joint_pos",),
        action_scale=0.25,
        **fields,
    )


def test_gains_and_pose_of_a_contract_arrive_in_the_robots_order():
    pose = np.where(np.arange(N) == 10, 0.3, 0.0)
    pose[3] = -0.01  # a knee cannot go below 0
    robot = with_contract(BIPED, contract(BIPED.joint_names[::-1], default_joint_pos=pose))
    assert robot.stiffness.tolist() == (np.arange(N) + 10.0)[::-1].tolist()
    assert robot.damping.tolist() == (np.arange(N) * 0.1)[::-1].tolist()
    placed = dict(zip(robot.joint_names, robot.initial_position, strict=True))
    assert (placed["left_knee_pitch"], placed["right_knee_pitch"]) == (0.3, 0.0)
    for standby in (robot.standby_controller_a, robot.standby_controller_b):
        assert standby.pose_segments == (robot.initial_position,)
        assert (standby.target_stiffness, standby.target_damping) == (tuple(robot.stiffness), tuple(robot.damping))
        assert standby.segment_durations == (2.0,)
    assert robot.mode_damping.tolist() == robot.passive_damping.tolist() == robot.damping.tolist()
    assert robot.joints[3].motor == BIPED.joints[3].motor


def test_lower_torque_limits_and_damping_of_the_training_are_the_robots():
    limits = np.full(N, np.inf)
    limits[0], limits[1] = 2.0, 1e6
    trained = contract(BIPED.joint_names[::-1], effort_limit=limits, model_joint_damping="drop")
    robot = with_contract_physics(BIPED, trained)
    assert robot.simulation.joint_damping == "drop"
    assert robot.effort_limit.tolist() == [*BIPED.effort_limit[:-1].tolist(), 2.0]
