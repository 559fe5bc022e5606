"""A URDF becomes an MJCF with the base that the user names, and what it does not say is listed."""

import mujoco
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robot import main
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.from_urdf import convert_urdf

LINK = """<link name="{name}"><inertial><mass value="{mass}"/><origin xyz="0 0 -0.1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry>{shape}</geometry></collision></link>"""
URDF = f"""<robot name="walker">
{LINK.format(name="pelvis", mass=4, shape='<box size="0.2 0.2 0.2"/>')}
{LINK.format(name="head", mass=1, shape='<sphere radius="0.1"/>')}
{LINK.format(name="leg", mass=2, shape='<mesh filename="package://walker/meshes/leg.obj"/>')}
<joint name="neck" type="fixed"><parent link="pelvis"/><child link="head"/><origin xyz="0 0 0.3"/></joint>
<joint name="hip" type="revolute"><parent link="pelvis"/><child link="leg"/><origin xyz="0 0 -0.1"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="0.5" effort="40" velocity="10"/></joint>
</robot>"""
TETRAHEDRON = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 -0.4\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"


@pytest.fixture
def urdf(tmp_path):
    (tmp_path / "walker" / "meshes").mkdir(parents=True)
    (tmp_path / "walker" / "meshes" / "leg.obj").write_text(TETRAHEDRON)
    path = tmp_path / "walker" / "walker.urdf"
    path.write_text(URDF)
    return path


def test_the_base_floats_and_every_link_stays(urdf, tmp_path, capsys):
    output = tmp_path / "elsewhere.xml"
    assert main(["convert", str(urdf), "--base", "floating", "--imu", "head", "--output", str(output)]) == 0
    model = mujoco.MjModel.from_xml_path(str(output))
    assert [model.body(i).name for i in range(model.nbody)] == ["world", "pelvis", "head", "leg"]
    assert (model.nv, model.joint("hip").range.tolist()) == (7, [-1.0, 0.5])
    assert model.body_subtreemass[0] == pytest.approx(7.0)
    assert 'file="walker/meshes/leg.obj"' in output.read_text()
    robot = load_robot(output)
    assert (robot.is_floating, robot.base.body, robot.imu) == (True, "pelvis", "imu")
    assert robot.joints[0].effort_limit == 40.0
    printed = capsys.readouterr().out
    assert "armature: 1 joints have none" in printed
    assert "contacts: 3 geoms collide with everything" in printed
    assert "IMU" not in printed


def test_a_fixed_base_hangs_where_it_is(urdf):
    text, gaps = convert_urdf(urdf, "fixed", urdf.parent)
    model = mujoco.MjModel.from_xml_string(text, {"meshes/leg.obj": TETRAHEDRON.encode()})
    assert model.nv == 1
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.body("head").xpos, [0.0, 0.0, 0.3], atol=1e-9)
    assert any(line.startswith("IMU: no site; --imu LINK adds one") for line in gaps)


@pytest.mark.parametrize(
    ("change", "arguments", "message"),
    [
        (
            ("leg.obj", "knee.obj"),
            {},
            "mesh 'package://walker/meshes/knee.obj' is not found; looked beside the URDF in: ",
        ),
        (("", ""), {"imu": "skull"}, "has no link 'skull' for the IMU; links: pelvis, head, leg"),
        (("<robot", "<robot><"), {}, "not a valid URDF: "),
    ],
)
def test_what_is_wrong_is_one_line(urdf, change, arguments, message):
    urdf.write_text(URDF.replace(*change, 1))
    with pytest.raises(InputError) as caught:
        convert_urdf(urdf, "floating", urdf.parent, **arguments)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_urdf_given_as_a_robot_names_the_command(urdf):
    with pytest.raises(InputError, match=r"is a URDF, .*humanoid_sim\.robot convert .*walker\.urdf --base floating"):
        load_robot(urdf)
