"""`robot describe` and `robot convert`: what they print, and the files that they write."""

import mujoco
import pytest

from humanoid_sim.cli import run_program
from humanoid_sim.robot import main
from humanoid_sim.robots.description import load_robot


def described(capsys, *arguments):
    """The cells of each table's rows by joint, and the text of each heading."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "160")
        assert main(["describe", *map(str, arguments)]) == 0
    lines = capsys.readouterr().out.splitlines()
    cells = [[cell.strip() for cell in line.split("│")[1:-1]] for line in lines if "│" in line]
    texts = dict(line.split("  ", 1) for line in lines if "  " in line and "│" not in line and "━" not in line)
    rows = [{row[0]: row[1:] for row in cells if len(row) == width} for width in (10, 6)]
    return *rows, {name: text for name, text in texts.items() if not name.startswith(("joints of", "the model"))}


def test_joints_own_actuators_and_what_else_is_read_are_shown(hopper, capsys):
    text = hopper.read_text()
    for old, new in (
        ('name="knee" axis', 'name="knee" damping="0.25" frictionloss="0.1" axis'),
        ('kp="100" forcerange="-30 40"', 'kp="100" kv="3" inheritrange="1"'),
        (
            "<sensor>",
            '<equality><joint joint1="spring" joint2="hip" polycoef="0.1 -2 0 0 0"/>'
            '<joint joint1="knee" active="false"/></equality><sensor>',
        ),
    ):
        assert old in text
        text = text.replace(old, new)
    hopper.write_text(text)
    joints, actuators, texts = described(capsys, hopper)
    assert joints["hip"] == ["-1 to 1", "20", "policy's", "policy's", "0.02", "0", "0", "0", "0"]
    assert joints["knee"] == ["0.2 to 2", "none", "policy's", "policy's", "0.02", "0.1", "0.25", "0", "0.2"]
    assert actuators["knee"] == ["servo", "100", "3", "any", "0.2 to 2"]
    assert actuators["hip"] == ["motor", "0", "0", "-20 to 20", "any"]
    assert texts["base"] == "floating, body 'trunk', starts with its lowest part on the floor"
    assert texts["IMU"] == "site 'my_imu' on 'trunk', the base"
    assert texts["CAN motors"].startswith("none")
    assert texts["passive joints"] == "spring"
    assert texts["without effort limit"] == "knee"
    assert not {"ranges", "gravity", "other actuators"} & texts.keys()
    assert texts["equalities"] == "spring = 0.1 -2 · hip, knee = 0 (inactive)"


def test_what_a_policy_could_not_know_of_a_model_is_shown(hopper, capsys):
    """Ranges that were meant in radians, another direction of gravity, a ball joint, an actuator of a tendon."""
    tendon = '<tendon><fixed name="rope"><joint joint="hip" coef="1"/></fixed></tendon>'
    ball = '<body><joint name="ball" type="ball"/><geom size="0.1"/></body></worldbody>'
    for old, new in (
        ('<keyframe><key qpos="0 0 2 1 0 0 0 0.5 0.5 0"/></keyframe>', ""),
        ('angle="radian"', 'angle="degree"'),
        ("<worldbody>", '<option gravity="0 -9.81 0"/><worldbody>'),
        ("</worldbody>", ball + tendon),
        ("<actuator>", '<actuator><motor name="winch" tendon="rope"/>'),
    ):
        assert old in hopper.read_text()
        hopper.write_text(hopper.read_text().replace(old, new, 1))
    _, _, texts = described(capsys, hopper)
    assert texts["ranges"] == "at most 0.0349 rad wide; is the compiler's angle right?"
    assert texts["gravity"] == "0 -9.81 0 m/s²; policies take -z for down"
    assert texts["passive joints"] == "spring, ball"
    assert texts["other actuators"] == "winch"


def test_motors_of_a_shipped_robot_are_shown(capsys):
    joints, actuators, texts = described(capsys, "lite_biped")
    assert (joints["left_knee_pitch"][1:4], actuators) == (["36", "80", "2"], {})
    assert texts["CAN motors"] == "6 rs-06, 2 rs-02, 4 rs-00, 2 rs-05"


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


@pytest.fixture
def urdf(tmp_path):
    """In a package, two folders below it; its mesh in the folder beside."""
    for name in ("meshes", "urdf"):
        (tmp_path / "walker" / name).mkdir(parents=True)
    text = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 -0.4\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    (tmp_path / "walker" / "meshes" / "leg.obj").write_text(text)
    path = tmp_path / "walker" / "urdf" / "walker.urdf"
    path.write_text(URDF)
    return path


def test_a_converted_urdf_floats_and_keeps_every_link(urdf, tmp_path, capsys):
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
    assert "a URDF has no armature" in capsys.readouterr().out


def test_a_fixed_base_stays_where_it_is(urdf):
    assert main(["convert", str(urdf), "--base", "fixed"]) == 0
    assert load_robot(urdf.with_suffix(".xml")).is_floating is False
    assert mujoco.MjModel.from_xml_path(str(urdf.with_suffix(".xml"))).nv == 1


@pytest.mark.parametrize(
    ("change", "options", "error"),
    [
        (("leg.obj", "knee.obj"), [], "does not find package:"),
        (("", ""), ["--imu", "skull"], "--imu: unknown link 'skull'; known: pelvis, head, leg"),
        (("<robot", "<robot><"), [], "not a valid URDF"),
        (("</robot>", "<xacro:include filename='arm'/></robot>"), [], "expand it with xacro"),
        (('type="fixed"', 'type="continuous"'), ["--imu", "hip"], "--imu: unknown link 'hip'"),
        (('<joint name="neck" type="fixed"', '<joint name="hip" type="continuous"'), [], "repeated name 'hip'"),
    ],
)
def test_a_urdf_that_cannot_be_converted_is_one_line(urdf, change, options, error, capsys):
    urdf.write_text(URDF.replace(*change, 1))
    assert run_program(main, ["convert", str(urdf), "--base", "floating", *options]) == 2
    captured = capsys.readouterr()
    assert error in captured.err
    assert captured.err.count("\n") == 1


def test_a_urdf_given_as_a_robot_names_the_command(urdf, capsys):
    assert run_program(main, ["describe", str(urdf)]) == 2
    assert "humanoid_sim.robot convert" in capsys.readouterr().err
    description = urdf.with_suffix(".yaml")
    description.write_text(f"mjcf: {urdf.name}")
    assert run_program(main, ["describe", str(description)]) == 2
    assert f"mjcf: is '{urdf.name}', expected the name of an MJCF" in capsys.readouterr().err
