"""The URDF of a model, as another reader sees it, against MuJoCo's forward kinematics."""

from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.mjcf import bare_model
from humanoid_sim.robots.urdf import urdf_of

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


def robot_of(name, folder):
    (folder / "odd.xml").write_text(MANY_JOINTS)
    paths = {"hopper": Path(__file__).parents[1] / "data" / "hopper.xml", "odd": folder / "odd.xml"}
    return load_robot(paths.get(name, name))


@pytest.mark.parametrize("name", ["lite", "lite_piano", "lite_biped", "hopper", "odd"])
def test_a_reader_has_the_links_limits_masses_and_shapes_of_the_model(name, tmp_path):
    description = robot_of(name, tmp_path)
    model = bare_model(description)
    text, rng = urdf_of(model, description), np.random.default_rng(3)
    spec = mujoco.MjSpec.from_string(text)
    spec.compiler.fusestatic = False
    urdf = spec.compile()
    data, read_data = mujoco.MjData(model), mujoco.MjData(urdf)
    for _ in range(5):
        for joint in (model.joint(i) for i in range(model.njnt)):
            if joint.type[0] != mujoco.mjtJoint.mjJNT_FREE:
                data.joint(joint.name).qpos[0] = read_data.joint(joint.name).qpos[0] = rng.uniform(-1.2, 1.2)
        for one, its in ((model, data), (urdf, read_data)):
            mujoco.mj_kinematics(one, its)
            mujoco.mj_comPos(one, its)
        for body in range(1, model.nbody):  # a link's origin is its joint's anchor
            expected, found = data.body(body), read_data.body(model.body(body).name or f"body_{body}")
            np.testing.assert_allclose(found.xmat, expected.xmat, atol=1e-6)
            if model.body_mass[body]:
                np.testing.assert_allclose(found.xipos, expected.xipos, atol=1e-6)
    root = ElementTree.fromstring(text)
    for joint in description.joints:
        is_bounded = np.isfinite(joint.upper - joint.lower)
        span = [joint.lower, joint.upper] if is_bounded else [0.0, 0.0]
        assert urdf.joint(joint.name).range.tolist() == pytest.approx(span)
        limit = root.find(f"joint[@name='{joint.name}']/limit").attrib
        assert (float(limit["velocity"]) > 1.0) is (joint.motor is not None)
        assert float(limit["effort"]) == (joint.effort_limit if np.isfinite(joint.effort_limit) else 0.0)
    assert urdf.body_mass.sum() == pytest.approx(model.body_mass.sum(), rel=1e-6)
    shown = model.geom_type[model.geom_group < 3].tolist()
    spheres = 2 * shown.count(mujoco.mjtGeom.mjGEOM_CAPSULE) + shown.count(mujoco.mjtGeom.mjGEOM_SPHERE)
    assert len(root.findall(".//visual/geometry/sphere")) == spheres


def test_the_imu_and_a_floating_base_are_links(tmp_path):
    odd, biped = robot_of("odd", tmp_path), load_robot("lite_biped")
    roots = [ElementTree.fromstring(urdf_of(bare_model(robot), robot)) for robot in (odd, biped)]
    assert roots[0].find("joint[@name='imu_fixed']/child").attrib["link"] == "imu"
    (joint,) = roots[1].findall("joint[@type='floating']")
    assert joint.find("parent").attrib["link"] == "world"
