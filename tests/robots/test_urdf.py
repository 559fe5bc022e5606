"""The URDF of a model, as an independent reader sees it, against MuJoCo's forward kinematics."""

from io import BytesIO
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from published import POLICIES, needs_policies

from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.mjcf import bare_model
from humanoid_sim.robots.urdf import links_of, urdf_of

pytestmark = pytest.mark.peers
yourdfpy = pytest.importorskip("yourdfpy", reason="yourdfpy is not installed (extra 'test-peers')")

SCALAR = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
MANY_JOINTS = """\
<mujoco model="odd"><compiler angle="radian"/><worldbody>
  <body name="base" pos="0.1 0.2 0.3" quat="0.8 0.2 0.4 0.4">
    <joint name="turn" axis="0 0 1" pos="0.05 0.02 0.01" ref="0.4"/>
    <joint name="slide" type="slide" axis="0.6 0.8 0" ref="-0.1" range="-1 1" limited="true"/>
    <joint name="swing" axis="1 0 0" pos="-0.03 0.04 0.06"/>
    <geom type="capsule" size="0.02 0.1"/>
    <site name="imu" pos="0.01 0.02 0.03" quat="0.5 0.5 0.5 -0.5"/>
    <body name="tip" pos="0 0 0.2" euler="0.3 -0.2 0.1"><geom type="box" size="0.01 0.02 0.03"/>
      <body pos="0 0.1 0"><joint name="last" axis="0 1 0" pos="0 0 0.07"/><geom size="0.01" group="4"/></body></body>
  </body></worldbody></mujoco>
"""


def odd_robot(folder):
    (folder / "odd.xml").write_text(MANY_JOINTS)
    return load_robot(folder / "odd.xml")


def robot_of(name, folder):
    hopper, g1 = Path(__file__).parents[1] / "data" / "hopper.xml", POLICIES / "models" / "unitree_g1" / "robot.xml"
    return odd_robot(folder) if name == "odd" else load_robot({"hopper": hopper, "g1": g1}.get(name, name))


def read(description):
    text = urdf_of(bare_model(description), description)
    return yourdfpy.URDF.load(
        BytesIO(text.encode()), load_meshes=False, build_collision_scene_graph=True, force_collision_mesh=False
    )


@pytest.mark.parametrize(
    "name", ["lite", "lite_neck", "lite_biped", "hopper", "odd", pytest.param("g1", marks=needs_policies)]
)
def test_an_independent_reader_has_the_links_where_mujoco_has_them(name, tmp_path):
    description = robot_of(name, tmp_path)
    model = bare_model(description)
    urdf, data, rng = read(description), mujoco.MjData(model), np.random.default_rng(3)
    links = [link for link in links_of(model) if link.body >= 0]
    assert len(links) == model.nbody - 1
    for _ in range(5):
        values = {}
        for joint in range(model.njnt):
            if mujoco.mjtJoint(int(model.jnt_type[joint])) in SCALAR:
                values[model.joint(joint).name] = data.qpos[model.jnt_qposadr[joint]] = rng.uniform(-1.2, 1.2)
        assert len(values) >= len(description.joint_names)
        mujoco.mj_kinematics(model, data)
        urdf.update_cfg(values)
        base = links[0].name  # a floating base is where the reader puts it
        at_base = urdf.get_transform(base, "world")
        moved = _pose(data, links[0].body, links[0].shift) @ np.linalg.inv(at_base)
        for link in links:
            expected = _pose(data, link.body, link.shift)
            found = moved @ urdf.get_transform(link.name, "world")
            assert np.abs(found - expected).max() < 1e-6, link.name
        if not description.is_floating:
            assert np.abs(moved - np.eye(4)).max() < 1e-6


def _pose(data, body, shift):
    pose = np.eye(4)
    pose[:3, :3] = data.xmat[body].reshape(3, 3)
    pose[:3, 3] = data.xpos[body] + pose[:3, :3] @ shift
    return pose


@pytest.mark.parametrize("name", ["lite", "lite_neck", "lite_biped", "hopper", "odd"])
def test_the_loader_of_another_library_takes_it_with_its_limits(name, tmp_path):
    description = robot_of(name, tmp_path)
    urdf = read(description)
    assert urdf.validate(), urdf.errors
    compiled = mujoco.MjModel.from_xml_string(urdf_of(bare_model(description), description))
    for joint in description.joints:
        found = compiled.joint(joint.name)
        bounds = [joint.lower, joint.upper] if np.isfinite(joint.upper - joint.lower) else [0.0, 0.0]
        assert found.range.tolist() == pytest.approx(bounds)
        limit = urdf.joint_map[joint.name].limit
        assert (limit.velocity > 1.0) is (joint.motor is not None)
        if joint.motor is not None:
            assert compiled.jnt_actfrcrange[found.id].tolist() == [-joint.effort_limit, joint.effort_limit]


def test_every_geom_that_is_shown_has_its_shapes():
    description = load_robot("lite")
    model = bare_model(description)
    root = ElementTree.fromstring(urdf_of(model, description))
    shown = [geom for geom in range(model.ngeom) if model.geom_group[geom] < 3]
    kinds = [mujoco.mjtGeom(int(model.geom_type[geom])) for geom in shown]
    capsules = kinds.count(mujoco.mjtGeom.mjGEOM_CAPSULE)
    assert len(root.findall(".//visual/geometry/cylinder")) == capsules + kinds.count(mujoco.mjtGeom.mjGEOM_CYLINDER)
    assert len(root.findall(".//visual/geometry/sphere")) == 2 * capsules + kinds.count(mujoco.mjtGeom.mjGEOM_SPHERE)
    assert capsules > 10
    assert root.find(".//mesh") is None


@pytest.mark.parametrize(("name", "count"), [("lite", 10), ("lite_neck", 10), ("lite_biped", 9), ("hopper", 2)])
def test_another_library_has_the_collision_shapes_where_mujoco_has_them(name, count, tmp_path):
    description = robot_of(name, tmp_path)
    model, urdf = bare_model(description), read(description)
    links = {link.body: link for link in links_of(model)}
    colliding = [geom for geom in range(model.ngeom) if model.geom_contype[geom] and model.geom_bodyid[geom]]
    assert len(colliding) == count
    for geom in colliding:
        link, radius, half = links[int(model.geom_bodyid[geom])], *model.geom_size[geom, :2]
        pose = np.eye(4)
        pose[:3, 3] = model.geom_pos[geom] - link.shift
        mujoco.mju_quat2Mat(turn := np.zeros(9), model.geom_quat[geom])
        pose[:3, :3] = turn.reshape(3, 3)
        shapes = [one for one in urdf.link_map[link.name].collisions if np.allclose(one.origin, pose, atol=1e-6)]
        boxes = [one.geometry.box.size for one in shapes if one.geometry.box]
        drums = [
            (one.geometry.cylinder.radius, one.geometry.cylinder.length) for one in shapes if one.geometry.cylinder
        ]
        assert np.allclose(boxes or drums, 2.0 * model.geom_size[geom] if boxes else (radius, 2.0 * half))


def test_limits_inertia_and_the_imu(tmp_path):
    description = load_robot("lite")
    model = bare_model(description)
    root = ElementTree.fromstring(urdf_of(model, description))
    limit = root.find("joint[@name='left_elbow_pitch']/limit")
    joint = next(joint for joint in description.joints if joint.name == "left_elbow_pitch")
    assert (float(limit.attrib["lower"]), float(limit.attrib["upper"])) == (joint.lower, joint.upper)
    assert float(limit.attrib["effort"]) == joint.effort_limit
    assert float(limit.attrib["velocity"]) == 33.0, "of an rs-00 without load"
    masses = [float(mass.attrib["value"]) for mass in root.iter("mass")]
    assert sum(masses) == pytest.approx(model.body_mass.sum(), rel=1e-9)
    odd = odd_robot(tmp_path)
    imu = ElementTree.fromstring(urdf_of(bare_model(odd), odd)).find("joint[@name='imu_fixed']/child")
    assert imu.attrib["link"] == "imu"


def test_a_floating_base_hangs_on_the_world():
    description = load_robot("lite_biped")
    root = ElementTree.fromstring(urdf_of(bare_model(description), description))
    (joint,) = root.findall("joint[@type='floating']")
    parent = joint.find("parent")
    assert parent.attrib["link"] == "world"
