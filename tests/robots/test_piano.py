"""The shipped pianos: their keys against the published figures, and the fields of a description."""

import json
from pathlib import Path

import pytest

from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.piano import TRIGGER, key_joint_names
from humanoid_sim.simulation.model import build_model

FIGURES = json.loads(Path(__file__).parent.parent.joinpath("data", "piano.json").read_text())


@pytest.mark.parametrize(("robot", "name"), [("lite_piano", "dep20"), ("lite_piano_nikomaku", "nikomaku")])
def test_keys_and_body_of_the_shipped_mjcf_are_the_published_ones(robot, name):
    model, data = build_model(load_robot(robot)), FIGURES[name]
    assert load_robot(robot).joints == load_robot("lite").joints
    assert key_joint_names() == tuple(key["joint"] for key in data["keys"])
    for key in data["keys"]:
        joint, body = model.joint(key["joint"]), model.body(key["body"])
        assert joint.range == pytest.approx(key["range"], abs=1e-11)
        assert TRIGGER * joint.range[1] == pytest.approx(key["trigger_angle"], abs=1e-11)
        assert joint.pos == pytest.approx(key["joint_pos"], abs=1e-11)
        assert body.pos == pytest.approx(key["pos"], abs=1e-11)
        assert body.mass[0] == pytest.approx(key["mass"], abs=1e-11)
        assert model.geom(key["body"]).size == pytest.approx(key["size"], abs=1e-11)
        found = joint.stiffness[0], joint.damping[0], model.qpos_spring[joint.qposadr[0]], joint.armature[0]
        assert found == pytest.approx([key[name] for name in ("stiffness", "damping", "springref", "armature")])
    for geom, box in zip(("piano_rear", "piano_under"), data["boxes"], strict=True):
        assert model.geom(geom).pos == pytest.approx(box["pos"], abs=1e-11)
        assert model.geom(geom).size == pytest.approx(box["size"], abs=1e-11)
