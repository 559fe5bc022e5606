"""Robots described by nothing but their MJCF, their IMU among them, and MuJoCo's one handler of warnings."""

import math

import mujoco
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import RobotDescription, load_robot, with_imu
from humanoid_sim.robots.mjcf import (
    bare_model,
    imu_line,
    mujoco_silenced,
    own_actuators,
    own_joint_damping,
    prefix_line,
)
from humanoid_sim.simulation.model import build_model
from humanoid_sim.simulation.mujoco_robot import MujocoRobot


def test_joints_are_the_actuated_hinges_in_the_models_order_with_the_actuators_limits(hopper):
    robot = load_robot(hopper)
    assert robot.name == "hopper"
    assert robot.joint_names == ("hip", "knee")  # not the spring; the actuators come the other way round
    assert (robot.lower.tolist(), robot.upper.tolist()) == ([-1.0, 0.2], [1.0, 2.0])
    assert robot.effort_limit.tolist() == [20.0, 40.0]  # gear 5 of a control of 4; the force range
    assert robot.initial_position == (0.0, 0.2)  # zero within the limits
    assert robot.standby_controller_a.pose_segments == ((0.0, 0.2),)
    assert not robot.stiffness.any()  # left to the policy
    hopper.write_text(hopper.read_text().replace('name="hip" axis', 'name="hip" actuatorfrcrange="-7 7" axis'))
    assert load_robot(hopper).effort_limit.tolist() == [7.0, 40.0], "a joint's own force range, if it is smaller"


def test_without_actuators_every_hinge_of_the_floating_robot_counts(tmp_path):
    path = tmp_path / "bare.xml"
    path.write_text("""
    <mujoco>
      <worldbody>
        <body name="door"><joint name="door_hinge"/><geom size="0.1"/></body>
        <body name="trunk">
          <freejoint/><geom size="0.1"/>
          <body>
            <joint name="hip"/><geom size="0.1"/>
            <body><joint name="knee" range="10 90"/><geom size="0.1"/></body>
          </body>
        </body>
      </worldbody>
    </mujoco>""")
    robot = load_robot(path)
    assert robot.name == "bare"
    assert robot.joint_names == ("hip", "knee")
    assert robot.effort_limit.tolist() == [math.inf, math.inf]
    assert (robot.joints[0].lower, robot.joints[0].upper) == (-math.inf, math.inf)
    assert robot.initial_position == (0.0, pytest.approx(math.radians(10)))
    assert robot.imu == "trunk"
    model = build_model(robot, affine_actuators=True)
    assert model.jnt_limited[model.joint("hip").id] == 0
    assert model.actuator_forcelimited.tolist() == [0, 0]
    assert MujocoRobot(robot).stability.measure(0.0).eigenvalue == 0.0


def test_what_is_not_limited_survives_json(tmp_path, hopper):
    hopper.write_text(hopper.read_text().replace(' range="-1 1"', "").replace('forcerange="-30 40"', ""))
    robot = load_robot(hopper)
    assert math.isinf(robot.joints[0].upper)
    assert math.isinf(robot.joints[1].effort_limit)
    assert RobotDescription.from_json(robot.to_json(), folder=str(tmp_path)) == robot


def test_the_base_floats_where_there_is_a_free_joint(hopper):
    robot = load_robot(hopper)
    assert (robot.is_floating, robot.base.body, robot.base.height) == (True, "trunk", None)
    hopper.write_text(hopper.read_text().replace("<freejoint/>", "").replace("0 0 2 1 0 0 0 0.5", "0.5"))
    robot = load_robot(hopper)
    assert (robot.is_floating, robot.simulation.physics_timestep) == (False, 0.0005)


def test_the_imu_is_the_site_of_the_gyro_then_one_named_so_then_the_base(hopper):
    assert load_robot(hopper).imu == "my_imu"
    hopper.write_text(hopper.read_text().replace('<gyro site="my_imu"/>', ""))
    assert load_robot(hopper).imu == "my_imu"
    hopper.write_text(hopper.read_text().replace("my_imu", "gadget"))
    assert load_robot(hopper).imu == "trunk"


@pytest.mark.parametrize(
    ("own", "used"), [(0.004, 0.001), (0.0005, 0.0005), (0.0003, 0.001), (0.005, 0.001), (1e-9, 0.001)]
)
def test_a_shorter_step_of_the_mjcf_is_kept_if_it_divides_the_control_period(hopper, own, used):
    hopper.write_text(hopper.read_text().replace('timestep="0.004"', f'timestep="{own}"'))
    assert load_robot(hopper).simulation.physics_timestep == used


def test_contacts_and_solver_stay_those_of_the_mjcf(hopper):
    own = mujoco.MjModel.from_xml_path(str(hopper))
    model = build_model(load_robot(hopper))
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    for option in ("cone", "impratio", "iterations", "ls_iterations", "solver", "tolerance", "enableflags"):
        assert getattr(model.opt, option) == getattr(own.opt, option)
    assert model.ngeom == own.ngeom  # its own floor, and no second one
    for field in ("contype", "conaffinity", "condim", "friction", "solref", "solimp", "margin", "priority"):
        assert np.array_equal(getattr(model, f"geom_{field}"), getattr(own, f"geom_{field}"))
    assert np.array_equal(model.dof_armature, own.dof_armature)
    assert (model.nu, model.nkey) == (0, 0)
    assert model.nsensor == 2  # the one that needed an actuator is gone


def test_includes_are_followed(tmp_path, hopper):
    (tmp_path / "parts").mkdir()
    hopper.rename(tmp_path / "parts" / "hopper.xml")
    scene = tmp_path / "scene.xml"
    scene.write_text('<mujoco model="scene"><include file="parts/hopper.xml"/></mujoco>')
    robot = load_robot(scene)
    assert robot.joint_names == ("hip", "knee")
    assert robot.mjcf_path == scene.resolve()
    MujocoRobot(robot)


REFUSED = [
    ("<mujoco><worldbody/></mujoco>", "has no hinge joint, expected a robot"),
    ("joints: []", "not a valid MJCF model: "),
    ('<mujoco><include file="nowhere.xml"/></mujoco>', "not a valid MJCF model: "),
    (
        '<mujoco><worldbody><body name="arm"><joint/><geom size="1"/></body></worldbody></mujoco>',
        "the joint of body 'arm' has no name; policies find joints by name",
    ),
    (
        '<mujoco><worldbody><body><joint name="j"/><geom size="1"/></body></worldbody></mujoco>',
        "the body that carries 'j' has no name; it is the base",
    ),
    (
        '<mujoco><asset><mesh file="gone.stl"/></asset><worldbody><body name="b"><joint name="j"/>'
        '<geom type="mesh" mesh="gone"/></body></worldbody></mujoco>',
        "does not compile: ",
    ),
]


@pytest.mark.parametrize(("text", "message"), REFUSED)
def test_what_is_no_robot_is_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "x.xml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_robot(path)
    assert str(caught.value).startswith(f"{path}: {message}")
    assert "\n" not in str(caught.value)


def test_the_joints_own_damping(hopper):
    for text, damping in ((" axis", {}), (' damping="0.25" axis', {"knee": 0.25})):  # the spring's is not the robot's
        hopper.write_text(hopper.read_text().replace('name="knee" axis', f'name="knee"{text}'))
        robot = load_robot(hopper)
        assert own_joint_damping(bare_model(robot), robot) == damping


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


@pytest.fixture
def prefixed(tmp_path):
    """As mjlab's `export_scene` names things."""
    (tmp_path / "meshes").mkdir()
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "f 1 2 3\nf 2 3 4\nf 5 6 7\nf 6 7 8\n"
    (tmp_path / "meshes" / "box.obj").write_text(text)
    path = tmp_path / "scene.xml"
    path.write_text(PREFIXED)
    return path


def test_a_prefix_of_all_names_is_left_out_and_the_robot_is_the_same(prefixed):
    robot, model = load_robot(prefixed), build_model(load_robot(prefixed))
    assert (robot.joint_names, robot.base.body, robot.imu) == (("hip",), "trunk", "imu")
    assert robot.effort_limit.tolist() == [4.0]
    assert prefix_line(prefixed) == "all names in scene.xml begin with 'r2/', which is left out"
    outer = prefixed.with_name("outer.xml")  # in an included file they stay
    outer.write_text('<mujoco><include file="scene.xml"/></mujoco>')
    assert (load_robot(outer).joint_names, prefix_line(outer)) == (("r2/hip",), "")
    own = mujoco.MjModel.from_xml_path(str(prefixed))
    for name in ("trunk", "thigh"):
        assert model.body(name).mass.tolist() == own.body(f"r2/{name}").mass.tolist()
    assert model.nexclude == own.nexclude == 1


@pytest.mark.parametrize("name", ["trunk", "thigh", "root", "hip"])
def test_a_prefix_that_one_name_lacks_stays(prefixed, name):
    prefixed.write_text(PREFIXED.replace(f'"r2/{name}"', f'"{name}"'))
    robot = load_robot(prefixed)
    assert robot.joint_names == (("hip",) if name == "hip" else ("r2/hip",))
    assert robot.imu == "r2/imu"
    assert prefix_line(prefixed) == ""


MJCF = """
<mujoco>
  <worldbody>
    <site name="camera"/>
    <body name="pelvis">
      <freejoint/><geom size="0.1"/>{pelvis}
      <body name="torso"><joint name="waist"/><geom size="0.1"/>{torso}
        <body name="mount"><geom size="0.1"/>{mount}</body>
      </body>
    </body>
  </worldbody>
  <sensor>{sensors}</sensor>
</mujoco>
"""
QUAT = '<framequat objtype="site" objname="{}"/>'


def robot_file(folder, *, pelvis="", torso="", mount="", sensors=""):
    sites = {"pelvis": pelvis, "torso": torso, "mount": mount}
    bodies = {body: "".join(f'<site name="{name}"/>' for name in names.split()) for body, names in sites.items()}
    path = folder / "robot.xml"
    path.write_text(MJCF.format(sensors=sensors, **bodies))
    return path


@pytest.mark.parametrize(
    ("sites", "sensors", "line"),
    [
        ({"pelvis": "a imu"}, '<gyro site="a"/>', "site 'a' on the base 'pelvis' (the site of a gyro)"),
        (
            {"pelvis": "a", "torso": "b"},
            '<gyro site="b"/><gyro site="a"/>',
            "site 'a' on the base 'pelvis' (the site of a gyro)",
        ),
        (
            {"pelvis": "imu", "torso": "b"},
            '<gyro site="b"/><gyro site="camera"/>',
            "site 'b' on 'torso', not the base 'pelvis' (the site of the only gyro)",
        ),
        (
            {"pelvis": "imu", "torso": "b"},
            QUAT.format("b"),
            "site 'imu' on the base 'pelvis' (a site of the base named like an IMU)",
        ),
        (
            {"mount": "b", "torso": "foot"},
            QUAT.format("b") + '<framepos objtype="site" objname="foot"/><accelerometer site="b"/>',
            "site 'b' on 'mount', not the base 'pelvis' (the only site with a sensor of its orientation)",
        ),
        (
            {"mount": "b", "torso": "c the_imu"},
            '<gyro site="b"/><gyro site="c"/>',
            "the base 'pelvis' itself (no site of the model is clearly the IMU; other sites could be it: "
            "b, c, the_imu)",
        ),
        ({}, "", "the base 'pelvis' itself (no site of the model is clearly the IMU)"),
    ],
)
def test_the_frame_that_is_taken(tmp_path, sites, sensors, line):
    robot = load_robot(robot_file(tmp_path, **sites, sensors=sensors))
    assert imu_line(bare_model(robot), robot) == line


def test_another_one_is_chosen(tmp_path):
    robot = load_robot(robot_file(tmp_path, pelvis="imu", torso="b"))
    chosen = with_imu(robot, "b")
    assert imu_line(bare_model(chosen), chosen) == "site 'b' on 'torso', not the base 'pelvis' (as it was given)"
    chosen = with_imu(robot, "torso")
    assert imu_line(bare_model(chosen), chosen) == "body 'torso', not the base 'pelvis' (as it was given)"
    assert with_imu(robot, None) is robot
    with pytest.raises(InputError, match=r"robot.xml: imu of 'robot': unknown site or body 'head'; known: "):
        bare_model(with_imu(robot, "head"))


def step_into_trouble():
    """A position that is not a number; returns how often MuJoCo has warned of it."""
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qpos[0] = float("nan")
    mujoco.mj_step(model, data)
    return int(data.warning[mujoco.mjtWarning.mjWARN_BADQPOS].number)


def test_nothing_is_written_and_warnings_still_count(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    with mujoco_silenced:
        assert step_into_trouble() == 1
    assert capfd.readouterr() == ("", "")
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def heard():
    """What MuJoCo warns of, by a handler that stands as long as the test."""
    messages = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(messages.append)
    yield messages
    mujoco.set_mju_user_warning(before)


def test_the_last_to_leave_puts_back_the_handler(heard):
    with mujoco_silenced:
        with mujoco_silenced:
            step_into_trouble()
        step_into_trouble()
    assert heard == []
    step_into_trouble()
    assert len(heard) == 1


def test_a_handler_set_while_another_simulation_steps_neither_hears_nor_is_lost(heard):
    with mujoco_silenced:  # the other simulation: a thread of emulated motors, say
        mujoco.set_mju_user_warning(heard.append)
        with mujoco_silenced:
            step_into_trouble()
        assert heard == []
    step_into_trouble()
    assert len(heard) == 1


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
INF = math.inf


@pytest.mark.parametrize(
    ("joint", "kind", "gains", "force", "target"),
    [
        ("servo", "servo", (40.0, 2.0), (-30.0, 20.0), (-1.0, 2.0)),
        ("geared", "servo", (40.0, 4.0), (-INF, INF), (-2.0, 0.5)),
        ("pair", "servo", (50.0, 3.0), (-6.0, 6.0), (-INF, INF)),
        ("motor", "motor", (0.0, 0.0), (-17.5, 15.0), (-INF, INF)),
        ("muscle", "other", (0.0, 0.0), (-INF, INF), (-INF, INF)),
    ],
)
def test_a_models_own_actuators_at_their_joints(joint, kind, gains, force, target):
    own = own_actuators(mujoco.MjModel.from_xml_string(ACTUATORS))[joint]
    assert (own.kind, (own.stiffness, own.damping)) == (kind, gains)
    assert (own.force_range, own.target_range) == (force, target)
