"""Robots described by nothing but their MJCF: joints, base, IMU, own actuators, and files that are missing."""

import math

import mujoco
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.mjcf import NO_RANGE, OwnActuator, bare_model, imu_line, own_actuators
from humanoid_sim.simulation.model import build_model

INF = math.inf
CORNERS = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
BOX = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS) + "f 1 2 3\nf 2 3 4\nf 5 6 7\nf 6 7 8\n"


def test_joints_are_the_actuated_hinges_in_the_models_order_with_the_actuators_limits(hopper):
    robot = load_robot(hopper)
    assert (robot.name, robot.joint_names) == ("hopper", ("hip", "knee"))  # the actuators come the other way round
    assert (robot.lower.tolist(), robot.upper.tolist()) == ([-1.0, 0.2], [1.0, 2.0])
    assert robot.effort_limit.tolist() == [20.0, 40.0]  # gear 5 of a control of 4; the force range
    assert robot.initial_position == (0.0, 0.2)  # zero within the limits
    assert robot.has_no_gains
    assert (robot.is_floating, robot.base.body, robot.base.height) == (True, "trunk", None)
    text = hopper.read_text().replace('name="hip" axis', 'name="hip" actuatorfrcrange="-7 7" axis')
    hopper.write_text(text.replace("<freejoint/>", "").replace("0 0 2 1 0 0 0 0.5", "0.5"))
    robot = load_robot(hopper)
    assert robot.effort_limit.tolist() == [7.0, 40.0], "a joint's own force range, if it is smaller"
    assert (robot.is_floating, robot.simulation.physics_timestep) == (False, 0.0005)


BARE = """<mujoco><worldbody>
<body name="door"><joint name="door_hinge"/><geom size="0.1"/></body>
<body name="trunk"><freejoint/><geom size="0.1"/>
  <body><joint name="hip"/><geom size="0.1"/><body><joint name="knee" range="10 90"/><geom size="0.1"/></body></body>
</body></worldbody></mujoco>"""


def test_without_actuators_every_hinge_of_the_floating_robot_counts(tmp_path):
    path = tmp_path / "bare.xml"
    path.write_text(BARE)
    robot = load_robot(path)
    assert (robot.name, robot.joint_names, robot.imu) == ("bare", ("hip", "knee"), "trunk")
    assert (robot.joints[0].lower, robot.joints[0].upper, robot.joints[0].effort_limit) == (-INF, INF, INF)
    assert robot.initial_position == (0.0, pytest.approx(math.radians(10)))
    model = build_model(robot, affine_actuators=True)
    assert (model.jnt_limited[model.joint("hip").id], model.actuator_forcelimited.tolist()) == (0, [0, 0])


ACTUATORS = """<mujoco><compiler angle="radian"/><worldbody><body name="base"><geom size="0.1"/>
<body><joint name="servo" range="-1 2" armature="0.1"/><geom size="0.1"/>
<body><joint name="geared"/><geom size="0.1"/>
<body><joint name="pair"/><geom size="0.1"/>
<body><joint name="motor"/><geom size="0.1"/>
<body><joint name="muscle"/><geom size="0.1"/></body></body></body></body></body></body></worldbody>
<actuator>
<motor joint="motor" gear="5" ctrlrange="-4 3" forcerange="-3.5 10"/>
<position joint="servo" kp="40" kv="2" forcerange="-30 20" inheritrange="1"/>
<position joint="geared" gear="-2" kp="10" kv="1" ctrlrange="-1 4"/>
<position joint="pair" kp="50" forcerange="-5 5"/><velocity joint="pair" kv="3" forcerange="-1 1"/>
<muscle joint="muscle" lengthrange="0 1"/>
</actuator></mujoco>"""


def test_a_models_own_actuators_at_their_joints():
    found = own_actuators(mujoco.MjModel.from_xml_string(ACTUATORS))
    assert found == {
        "servo": OwnActuator("servo", "servo", 40.0, 2.0, (-30.0, 20.0), (-1.0, 2.0)),
        "geared": OwnActuator("geared", "servo", 40.0, 4.0, NO_RANGE, (-2.0, 0.5)),
        "pair": OwnActuator("pair", "servo", 50.0, 3.0, (-6.0, 6.0), NO_RANGE),
        "motor": OwnActuator("motor", "motor", 0.0, 0.0, (-17.5, 15.0), NO_RANGE),
        "muscle": OwnActuator("muscle", "other", 0.0, 0.0, NO_RANGE, NO_RANGE),
    }


MESHES = """<mujoco><compiler meshdir="assets"/><asset>{}</asset><worldbody><body name="b"><joint name="j"/>
<geom type="mesh" mesh="leg"/></body></worldbody></mujoco>"""
LEG = '<mesh name="leg" file="{}"/>'
WALKER = '<body name="{0}"><freejoint/><geom size="1"/><body><joint name="{0}_leg"/><geom size="1"/></body></body>'
TWO = f"<mujoco><worldbody>{WALKER.format('left')}{WALKER.format('right')}</worldbody></mujoco>"
ARM = '<mujoco><worldbody><body{}><joint{}/><geom size="1"/></body></worldbody></mujoco>'


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("<mujoco><worldbody/></mujoco>", "has no hinge joint"),
        ("joints: []", "not a valid MJCF model"),
        (TWO, "its joints are on 'left', 'right', expected one floating base"),
        (ARM.format(' name="arm"', ""), "a hinge joint or its base has no name"),
        (MESHES.format(LEG.format("leg.stl") + '<mesh file="1.stl"/>'), "does not compile: "),
        (MESHES.format(""), "does not compile: "),
    ],
)
def test_what_is_no_robot_is_refused_in_one_line(tmp_path, text, problem):
    path = tmp_path / "x.xml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_robot(path)
    assert str(caught.value).startswith(f"{path}: {problem}")
    assert "\n" not in str(caught.value)


def test_a_mesh_that_was_not_fetched_is_named(tmp_path):
    (tmp_path / "assets").mkdir()
    (tmp_path / "assets" / "leg.stl").write_text("version https://git-lfs.github.com/spec/v1")
    (tmp_path / "x.xml").write_text(MESHES.format(LEG.format("leg.stl")))
    with pytest.raises(InputError, match=r"leg.stl: is a pointer of Git LFS"):
        load_robot(tmp_path / "x.xml")


@pytest.mark.parametrize("is_named", [True, False])
def test_a_package_path_is_in_the_folder_above_that_is_the_package(tmp_path, is_named):
    package = tmp_path / ("my_robot" if is_named else "checkout")
    (package / "meshes").mkdir(parents=True)
    (package / "mjcf").mkdir()
    (package / "meshes" / "leg.obj").write_text(BOX)
    if not is_named:
        (package / "package.xml").write_text("<package><name>my_robot</name></package>")
    path = package / "mjcf" / "x.xml"
    path.write_text(MESHES.format(LEG.format("package://my_robot/meshes/leg.obj")))
    assert bare_model(load_robot(path)).nmesh == 1
    if is_named:  # from a folder beside it
        assert bare_model(load_robot(path.rename(tmp_path / "x.xml"))).nmesh == 1


PREFIXED = """
<mujoco model="scene">
  <compiler meshdir="meshes"/>
  <default><default class="r2/main"><geom rgba="1 0 0 1"/><default class="r2/leg"/></default></default>
  <asset><mesh name="r2/box" file="box.obj"/></asset>
  <worldbody>
    <body name="terrain"><geom name="terrain" type="plane" size="1 1 1"/></body>
    <body name="r2/trunk" childclass="r2/leg">
      <freejoint name="r2/root"/><geom type="mesh" mesh="r2/box"/><site name="r2/imu"/>
      <body name="r2/thigh"><joint name="r2/hip"/><geom name="r2/thigh" size="0.1"/></body>
    </body>
  </worldbody>
  <contact><exclude body1="r2/trunk" body2="r2/thigh"/></contact>
  <actuator><motor name="r2/hip" joint="r2/hip" ctrlrange="-4 4"/></actuator>
  <sensor><gyro name="r2/gyro" site="r2/imu"/></sensor>
</mujoco>"""


def test_a_prefix_of_all_names_is_left_out_and_the_robot_is_the_same(tmp_path):
    """As mjlab's `export_scene` names things."""
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "box.obj").write_text(BOX)
    path = tmp_path / "scene.xml"
    path.write_text(PREFIXED)
    robot, model = load_robot(path), build_model(load_robot(path))
    assert (robot.joint_names, robot.base.body, robot.imu) == (("hip",), "trunk", "imu")
    assert robot.effort_limit.tolist() == [4.0]
    own = mujoco.MjModel.from_xml_path(str(path))
    assert [model.body(name).mass[0] for name in ("trunk", "thigh")] == own.body_mass[2:].tolist()
    assert model.nexclude == own.nexclude == 1


def robot_with(folder, *, pelvis="", torso="", sensors=""):
    """A robot with these sites on its bodies."""
    pelvis, torso = ("".join(f'<site name="{name}"/>' for name in names.split()) for names in (pelvis, torso))
    path = folder / "robot.xml"
    path.write_text(f"""
    <mujoco><worldbody><site name="camera"/>
      <body name="pelvis"><freejoint/><geom size="0.1"/>{pelvis}
        <body name="torso"><joint name="waist"/><geom size="0.1"/>{torso}</body></body>
    </worldbody><sensor>{sensors}</sensor></mujoco>""")
    return load_robot(path)


GYROS = '<gyro site="{}"/><gyro site="{}"/>'
IMUS = [
    ({"pelvis": "a imu", "sensors": '<gyro site="a"/>'}, "site 'a' on 'pelvis', the base"),
    ({"pelvis": "imu", "torso": "b", "sensors": GYROS.format("b", "camera")}, "site 'b' on 'torso', not the base"),
    ({"pelvis": "imu", "torso": "b"}, "site 'imu' on 'pelvis', the base"),
    ({}, "body 'pelvis', the base"),
]


@pytest.mark.parametrize(("sites", "line"), IMUS)
def test_the_frame_that_is_the_imu(tmp_path, sites, line):
    robot = robot_with(tmp_path, **sites)
    assert imu_line(bare_model(robot), robot).startswith(line)
