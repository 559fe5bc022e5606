import json
import re
from pathlib import Path

import pytest

from humanoid_sim.assets import asset_path
from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.robots.piano import PIANOS, TRIGGER, key_joint_names
from humanoid_sim.simulation.model import build_model

FIGURES = json.loads(Path(__file__).parent.parent.joinpath("data", "piano.json").read_text())


@pytest.mark.parametrize("name", ["dep20", "nikomaku"])
def test_keys_and_body_are_the_data_s(name):
    figures, data = PIANOS[name], FIGURES[name]
    assert len(figures.keys) == len(data["keys"]) == 88
    for key, expected in zip(figures.keys, data["keys"], strict=True):
        assert (key.name, key.joint) == (expected["body"], expected["joint"])
        assert key.box.position == pytest.approx(expected["pos"], abs=1e-11)
        assert key.box.size == pytest.approx(expected["size"], abs=1e-11)
        assert key.hinge - key.box.position[0] == pytest.approx(expected["joint_pos"][0], abs=1e-11)
        assert [0.0, key.upper] == pytest.approx(expected["range"], abs=1e-11)
        assert TRIGGER * key.upper == pytest.approx(expected["trigger_angle"], abs=1e-11)
        assert key.mass == expected["mass"]
        assert (figures.stiffness, figures.damping) == (expected["stiffness"], expected["damping"])
        assert (figures.spring_reference, figures.armature) == (expected["springref"], expected["armature"])
    for box, expected in zip(figures.boxes, data["boxes"], strict=True):
        assert box.position == pytest.approx(expected["pos"], abs=1e-12)
        assert box.size == pytest.approx(expected["size"], abs=1e-12)


@pytest.mark.parametrize(("robot", "name"), [("lite_piano", "dep20"), ("lite_piano_nikomaku", "nikomaku")])
def test_the_shipped_mjcf_has_the_figures(robot, name):
    model, figures = build_model(load_robot(robot)), PIANOS[name]
    for key in figures.keys:
        joint, geom = model.joint(key.joint), model.geom(key.name)
        assert joint.range == pytest.approx([0.0, key.upper], abs=1e-11)
        assert joint.pos[0] == pytest.approx(key.hinge - key.box.position[0], abs=1e-11)
        assert model.body(key.name).pos == pytest.approx(key.box.position, abs=1e-11)
        assert geom.size == pytest.approx(key.box.size, abs=1e-11)
        assert model.body(key.name).mass[0] == pytest.approx(key.mass, abs=1e-11)
        found = joint.stiffness[0], joint.damping[0], model.qpos_spring[joint.qposadr[0]], joint.armature[0]
        expected = figures.stiffness, figures.damping, figures.spring_reference, figures.armature
        assert found == pytest.approx(expected, abs=1e-11)


def test_keys_of_all_pianos_are_called_alike():
    assert key_joint_names()[:3] == ("white_joint_0", "black_joint_1", "white_joint_2")
    assert all(tuple(key.joint for key in figures.keys) == key_joint_names() for figures in PIANOS.values())


@pytest.mark.parametrize(("name", "figures"), [("lite_piano", "dep20"), ("lite_piano_nikomaku", "nikomaku")])
def test_the_robot_is_the_lite_with_a_piano(name, figures):
    lite, robot = load_robot("lite"), load_robot(name)
    assert robot.joints == lite.joints
    assert robot.piano.figures == figures
    again = RobotDescription.from_json(robot.to_json(), folder=robot.folder)
    assert again == robot


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("figures: dep20", "figures: grand", "figures: unknown piano 'grand'; known: dep20, nikomaku"),
        ("_tip, right_finger2_tip]", "_tip]", "fingers: has 1 sites, expected 2, the left hand's first"),
        ("reach: [[5, 55], ", "reach: [", "reach: has 1 spans, expected one for each of the piano's fingers"),
        ("[5, 55]", "[5, 88]", "reach[0]: is [5, 88], expected the lowest and the highest key of 0 to 87"),
        ("key_force_limit: 14.0", "key_force_limit: 0", "key_force_limit: is 0.0, expected a finite number > 0"),
    ],
)
def test_a_wrong_piano_is_refused(tmp_path, old, new, problem):
    text = asset_path("robots", "lite_piano.yaml").read_text()
    assert text.count(old) == 1
    path = tmp_path / "robot.yaml"
    path.write_text(text.replace(old, new).replace("../mjcf", str(asset_path("mjcf"))))
    with pytest.raises(InputError, match=re.escape(f"robot.yaml: piano.{problem}")):
        load_robot(path)


def test_the_keys_force_limit_follows_from_motor_and_keys():
    """Five times what holds the stiffest key down where it is struck, and less than the wrist can press with."""
    robot = load_robot("lite_piano")
    figures = PIANOS["dep20"]
    held = max(figures.stiffness * (key.upper - figures.spring_reference) / (key.lever - 0.01) for key in figures.keys)
    assert robot.piano.key_force_limit == pytest.approx(5.0 * held, abs=0.1)
    assert robot.piano.key_force_limit < robot.effort_limit[6] / 0.225
