"""Every way in which a description can be wrong, and the one line that says so."""

import copy
import math
import os
import re
import subprocess
import sys

import msgspec
import pytest
import yaml

from humanoid_sim.assets import asset_path
from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import RobotDescription, load_robot, shipped_robots
from humanoid_sim.robots.motors import FAMILIES

LITE = yaml.safe_load(asset_path("robots", "lite.yaml").read_text())


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
    result = copy.deepcopy(LITE)
    result["mjcf"] = str(asset_path("mjcf", "lite.xml").resolve())
    return result


def set_at(document, place, value):
    """Set the value at a place such as `joints[3].upper`."""
    *keys, last = [int(key) if key.isdigit() else key for key in re.findall(r"[^.\[\]]+", place)]
    inner = document
    for key in keys:
        inner = inner[key]
    inner[last] = value


ELBOW = "outside the limits of left_elbow_pitch, -2.35619 to 0"
PER_JOINT = "expected 14, one per joint"
STANDBY = "standby_controller_a"
REMOTE = "remote_policy_controller"

BAD_VALUES = [
    ("name", 3, "is 3, expected a text"),
    ("mjcf", "nowhere.xml", "'nowhere.xml' is not a file; it is looked up beside the description"),
    ("mjcf", "x" * 5000, f"'{'x' * 5000}' is not a file; it is looked up beside the description"),
    ("imu", "", "is empty, expected a text"),
    ("hands", ["left_hand", "left_hand"], "has the same entry 'left_hand' as hands[0]"),
    ("folder", "/", "is not a field of the file; give 'mjcf' relative to the file instead"),
    ("joints", [], "is empty, expected at least one joint"),
    ("joints", "all", "is 'all', expected a list"),
    ("joints[1].name", " ", "is empty, expected a text"),
    ("joints[3].lower", float("nan"), "is nan, expected a finite number"),
    ("joints[3].upper", "high", "is 'high', expected a number"),
    ("joints[3].upper", None, "is nothing, expected a number"),
    ("joints[3].upper", -3.0, "is -3, expected more than lower, which is -2.35619 (left_elbow_pitch)"),
    ("joints[0].effort_limit", 0.0, "is 0.0, expected a finite number > 0"),
    ("joints[0].effort_limit", float("inf"), "is inf, expected a finite number > 0"),
    ("joints[0].stiffness", -1.0, "is -1.0, expected a finite number >= 0"),
    ("joints[0].damping", True, "is True, expected a number"),
    ("joints[1].motor", "rs-00", "is 'rs-00', expected a mapping or null"),
    ("joints[1].motor.direction", 2, "is 2, expected one of -1, 1"),
    ("joints[1].motor.can_id", 0, "is 0, expected 1 to 127"),
    ("joints[1].motor.can_id", 1.5, "is 1.5, expected a whole number"),
    ("joints[1].motor.can_id", 11, "is 11, which is taken by joints[0] (left_shoulder_pitch)"),
    ("joints[1].motor.bus", -1, "is -1, expected a 0-based index"),
    ("joints[1].motor.torque_limit", -1, "is -1.0, expected a finite number >= 0"),
    ("joints[1].motor.current_limit", -1, "is -1.0, expected a finite number >= 0"),
    ("initial_position", [0.0] * 13, f"has 13 values, {PER_JOINT}"),
    ("initial_position[3]", 0.1, f"is 0.1, {ELBOW}"),
    ("initial_position[3]", float("nan"), f"is nan, {ELBOW}"),
    (
        "simulation.physics_timestep",
        0.0006,
        "0.0006 s does not divide the control period of 0.005 s; the nearest that does is 0.000625 s (8 per period)",
    ),
    (
        "simulation.physics_timestep",
        1e-300,
        "is 1e-300 s, expected at least 5e-07 s, which makes 10000 steps of a control period of 0.005 s",
    ),
    ("simulation.physics_timestep", 0.0, "is 0.0, expected a finite number > 0"),
    ("simulation.control_frequency", -200, "is -200.0, expected a finite number > 0"),
    ("simulation.floor_height", float("inf"), "is inf, expected a finite number"),
    ("base", "floating", "is 'floating', expected a mapping"),
    ("base", {"type": "floating", "body": " "}, "is empty, expected a text"),
    ("base", {"type": "flying"}, "is 'flying', expected one of fixed, floating"),
    ("base", {"height": float("nan")}, "is nan, expected a finite number"),
    ("base", {"height": "high"}, "is 'high', expected a number or null"),
    ("hardware.control_frequency", 0, "is 0.0, expected a finite number > 0"),
    ("hardware.rx_timeout_ms", "fast", "is 'fast', expected a number"),
    ("damping_controller.damping_scalar", -5.0, "is -5.0, expected a finite number >= 0"),
    ("damping_controller.damping", [1.0], f"has 1 values, {PER_JOINT}"),
    (f"{STANDBY}.target_stiffness[2]", -1.0, "is -1.0, expected a finite number >= 0"),
    (f"{STANDBY}.target_damping", [], f"has 0 values, {PER_JOINT}"),
    (f"{STANDBY}.segment_durations[1]", 0.0, "is 0.0, expected a finite number > 0"),
    (f"{STANDBY}.pose_segments", [[0.0] * 14], "has 1 poses, expected 2, one per segment duration"),
    (f"{STANDBY}.pose_segments[1]", [0.0], f"has 1 values, {PER_JOINT}"),
    (f"{STANDBY}.pose_segments[1][3]", 1.0, f"is 1, {ELBOW}"),
    (f"{REMOTE}.stale_command_policy", "freeze", "is 'freeze', expected one of passive, hold"),
    (f"{REMOTE}.stale_command_timeout_ms", 0, "is 0.0, expected a finite number > 0"),
]


@pytest.mark.parametrize(("place", "value", "problem"), BAD_VALUES)
def test_a_bad_value_is_named(tmp_path, document, place, value, problem):
    set_at(document, place, value)
    where = "hands[1]" if place == "hands" else place
    if place == "base" and isinstance(value, dict):
        where = f"base.{list(value)[-1]}"
    assert refusal(write(tmp_path, document)) == f"{where}: {problem}"


SITO = {"family": "sito", "bus": 0, "can_id": 17, "model": "TA40-50", "direction": -1}
FAMILY_PROBLEMS = [
    ({"family": "sito"}, "joints[6].motor.family: is sito, but a rs-05 is of robstride"),
    ({"family": "etob"}, f"joints[6].motor.family: unknown family 'etob'; known: {', '.join(FAMILIES)}"),
    ({"torque_limit": None}, "joints[6].motor: misses 'torque_limit'"),
    (SITO | {"family": "robstride"}, "joints[6].motor.family: is robstride, but a TA40-50 is of sito"),
    (
        SITO | {"torque_limit": 4.0},
        "joints[6].motor.torque_limit: is 4, but no such limit of sito motors is known; leave it out",
    ),
    (SITO | {"can_id": 200}, "joints[6].motor.can_id: is 200, expected 1 to 127 beside motors of another family"),
    (SITO | {"can_id": 11}, "joints[6].motor.can_id: is 11, which is taken by joints[0] (left_shoulder_pitch)"),
]


@pytest.mark.parametrize(("change", "line"), FAMILY_PROBLEMS)
def test_a_motor_that_does_not_fit_its_family(tmp_path, document, change, line):
    motor = {} if "bus" in change else document["joints"][6]["motor"]
    document["joints"][6]["motor"] = motor | change
    assert refusal(write(tmp_path, document)).startswith(line)


def test_an_id_that_another_familys_frames_could_address(tmp_path, document):
    document["joints"][3]["motor"]["can_id"] = 9  # the last byte of a Sito command's identifier
    load_robot(write(tmp_path, document))
    document["joints"][6]["motor"] = SITO
    problem = "joints[3].motor.can_id: is 9, which frames to sito motors of this robot"
    assert refusal(write(tmp_path, document)).startswith(problem)


UNKNOWN_FIELDS = [
    (
        "stifness",
        "unknown field 'stifness'; known: name, topic_prefix, mjcf, joints, initial_position, imu, base, hands, ",
    ),
    ("joints[2].limit", "joints[2]: unknown field 'limit'; known: name, lower, upper, effort_limit, stiffness, "),
    ("joints[2].motor.id", "joints[2].motor: unknown field 'id'; known: family, bus, can_id, model, direction, "),
    (f"{STANDBY}.poses", f"{STANDBY}: unknown field 'poses'; known: target_stiffness, target_damping, "),
]


@pytest.mark.parametrize(("place", "line"), UNKNOWN_FIELDS)
def test_an_unknown_field_lists_the_known_ones(tmp_path, document, place, line):
    set_at(document, place, 1.0)
    told = refusal(write(tmp_path, document))
    assert told.startswith(line)
    assert "folder" not in told


@pytest.mark.parametrize("name", ["name", "mjcf", "imu", "initial_position", "standby_controller_a"])
def test_a_missing_field_and_a_joint_given_twice_are_named(tmp_path, document, name):
    whole = copy.deepcopy(document)
    del document[name]
    assert refusal(write(tmp_path, document)) == f"misses required field '{name}'"
    whole["joints"][5]["name"] = "left_shoulder_pitch"
    assert refusal(write(tmp_path, whole)) == "joints[5]: has the same name 'left_shoulder_pitch' as joints[0]"


BAD_TEXTS = [
    ("", "is empty, expected a robot description"),
    ("# nothing here\n", "is empty, expected a robot description"),
    ("- a\n- b\n", "is a list, expected a mapping with name, mjcf, joints, …"),
    ("lite", "is a text, expected a mapping with name, mjcf, joints, …"),
    ("name: [lite\njoints: 3\n", "line 2, column 7: not valid YAML: "),
    ("name: lite\n\tmjcf: x\n", "line 2, column 1: not valid YAML: "),
    ("name: lite\nname: heavy\n", "line 2, column 1: not valid YAML: 'name' is given twice"),
    ("name: 2020-99-99\n", "not YAML that can be read: month must be in 1..12"),
    ("name: !!bool lite\n", "not YAML that can be read: "),
    ("name: lite\n? [a]\n: 3\n", "line 2, column 3: not valid YAML: found unhashable key"),
    ("name: !!python/object:os.system {}\n", "line 1, column 7: not valid YAML: could not determine a constructor"),
]


@pytest.mark.parametrize(("text", "line"), BAD_TEXTS)
def test_a_file_that_is_no_description(tmp_path, text, line):
    assert refusal(write(tmp_path, text)).startswith(line)


def test_what_is_no_file_of_text(tmp_path, document):
    pipe, path = tmp_path / "pipe.yaml", tmp_path / "robot.yaml"
    os.mkfifo(pipe)
    assert refusal(pipe) == "is a pipe or a device, expected a robot's YAML file or an MJCF"
    path.write_bytes(b"\xff\xfe\x00\x01")
    assert refusal(path) == "is not a text file (UTF-8), expected a YAML file"
    assert refusal(tmp_path) == f"is a folder, expected a robot's YAML file, an MJCF or one of: {', '.join(SHIPPED)}"
    del document["name"]
    text = write(tmp_path, document).read_text()  # and a number that Python does not write out
    assert refusal(write(tmp_path, f"{text}name: {1 << 20_000:#x}\n")) == (
        "name: is a number of 20001 bits, expected a text"
    )


SHIPPED = ("lite", "lite_biped", "lite_neck", "lite_piano", "lite_piano_nikomaku", "lite_sito")


def test_an_unknown_name_lists_the_shipped_robots():
    assert shipped_robots() == SHIPPED
    with pytest.raises(InputError) as caught:
        load_robot("lit")
    known = ", ".join((*SHIPPED, "robot_descriptions:NAME"))
    assert str(caught.value) == f"unknown robot 'lit' (did you mean 'lite'?); known: {known}; or a file that exists"
    with pytest.raises(InputError, match=r"^unknown robot 'xxxx.*x'; known: lite"):
        load_robot("x" * 5000)


def test_a_path_is_a_robot_of_the_same_form(tmp_path, document):
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "mine.xml").write_text("<mujoco/>")
    document["mjcf"] = "models/mine.xml"
    robot = load_robot(write(tmp_path, document))
    assert robot.mjcf_path == (tmp_path / "models" / "mine.xml").resolve()
    assert robot.joint_names == load_robot("lite").joint_names


def test_defaults_are_those_of_the_controllers(tmp_path, document):
    for name in ("simulation", "hardware", "damping_controller", "remote_policy_controller", "hands"):
        del document[name]
    robot = load_robot(write(tmp_path, document))
    assert (robot.simulation.physics_timestep, robot.simulation.control_frequency) == (0.0005, 200.0)
    assert (robot.hardware.control_frequency, robot.hardware.rx_timeout_ms) == (50.0, 200.0)
    assert robot.damping_controller.damping_scalar == 1.0
    assert robot.remote_policy_controller.damping_scalar is None
    assert robot.passive_damping.tolist() == robot.mode_damping.tolist() == [1.0] * robot.joint_count
    assert robot.hands == ()


def test_the_passive_hold_damps_as_damping_does_unless_it_is_given_its_own(tmp_path, document):
    document["damping_controller"] = {"damping": [float(i) for i in range(len(document["joints"]))]}
    document["remote_policy_controller"] = {"stale_command_timeout_ms": 50}
    robot = load_robot(write(tmp_path, document))
    assert robot.passive_damping.tolist() == robot.mode_damping.tolist() == document["damping_controller"]["damping"]
    again = RobotDescription.from_json(robot.to_json())
    assert again.passive_damping.tolist() == robot.mode_damping.tolist()
    document["remote_policy_controller"] = {"damping_scalar": 3.0}
    assert load_robot(write(tmp_path, document)).passive_damping.tolist() == [3.0] * robot.joint_count


@pytest.mark.parametrize("name", shipped_robots())
def test_remotes_passive_hold_of_every_shipped_robot_damps_as_damping_does(name):
    robot = load_robot(name)
    assert robot.passive_damping.tolist() == robot.mode_damping.tolist()
    assert (robot.passive_damping > 0.0).all()


def test_loading_does_not_import_the_simulator():
    program = (
        "import sys; from humanoid_sim.robots.description import load_robot; load_robot('lite'); "
        "sys.exit('mujoco' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def completed(hopper, text):
    path = hopper.with_name("mine.yaml")
    path.write_text(f"mjcf: hopper.xml\n{text}")
    return load_robot(path)


def test_nothing_but_the_mjcf_is_the_robot_of_the_mjcf(hopper):
    assert completed(hopper, "") == load_robot(hopper)
    assert completed(hopper, "").has_no_gains
    assert not completed(hopper, "joints: {hip: {stiffness: 20, damping: 1}}").has_no_gains


def test_single_fields(hopper):
    text = """
imu: thigh
base: {height: 0.7}
simulation: {physics_timestep: 0.0005, joint_damping: drop}
standby_controller_a: {segment_durations: [0.5]}
initial_position: {knee: 0.6}
joints: {hip: {effort_limit: 12, upper: 0.8}}
"""
    changed, plain = completed(hopper, text), load_robot(hopper)
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
    free = completed(hopper, "imu: trunk\n")
    assert (free.joints[0].lower, free.joints[1].effort_limit) == (-math.inf, math.inf)
    assert completed(hopper, "initial_position: {hip: 5.0}").initial_position == (5.0, 0.2)


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
        (None, "mjcf: 'hopper.xml' is not a file; it is looked up beside"),
    ],
)
def test_what_is_wrong_is_named(hopper, text, message):
    if text is None:
        hopper.unlink()
    path = write(hopper.parent, f"mjcf: hopper.xml\n{text or ''}")
    assert refusal(path).startswith(message)
