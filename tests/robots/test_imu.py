"""Which frame of an MJCF is taken for the IMU, and how that is told."""

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot, with_imu
from humanoid_sim.robots.imu import imu_line
from humanoid_sim.robots.mjcf import bare_model

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
